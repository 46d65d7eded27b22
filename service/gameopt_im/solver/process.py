"""The parent's end of a worker process: start it, send it batches, take its answers, notice its end."""

from __future__ import annotations

import asyncio
import os
import pickle
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Callable

from gameopt_im.solver import worker
from gameopt_im.solver.worker import Answer, Batch, Ready, Start

START_TIMEOUT_S = 60.0
"""A worker that is not ready by then will not be."""
SINGLE_THREADED = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Workers are the parallelism; numpy starts no threads of its own in them."""


class PoolError(Exception):
    """A worker did not come up."""


def _run(descriptor: int) -> subprocess.Popen[bytes]:
    """A worker process with one end of a socket as its only inheritance.

    By exec, not by fork: the parent has threads of its own (Zenoh) that a fork would tear.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-c", f"from gameopt_im.solver.worker import main; main({descriptor})"],
        pass_fds=[descriptor],
        stdin=subprocess.DEVNULL,
        process_group=0,  # out of reach of the terminal's Ctrl-C
        env={**os.environ, **SINGLE_THREADED, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )


class Worker(asyncio.Protocol):
    """The parent's end of one worker process; what it owes is (call number, place), in the order sent."""

    def __init__(self, answered: Callable[[Answer], None], lost: Callable[[Worker], None]) -> None:
        self._answered = answered
        self._lost = lost
        self._buffer = bytearray()
        self._ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.owes: deque[tuple[int, int]] = deque()
        self.alive = True

    async def start(self, start: Start) -> None:
        """Run the process until it has warmed up; raises PoolError where it ends or hangs before."""
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = _run(theirs.fileno())
        self._transport, _ = await asyncio.get_running_loop().create_unix_connection(lambda: self, sock=ours)
        self._transport.write(worker.frame(start))
        try:
            async with asyncio.timeout(START_TIMEOUT_S):
                await self._ready
        except BaseException as error:
            self.stop()
            if isinstance(error, TimeoutError):
                raise PoolError(f"a solver worker was not ready within {START_TIMEOUT_S} s") from None
            raise

    def send(self, batch: Batch) -> None:
        """Give it work."""
        message = worker.frame(batch)
        self.owes.extend((batch.number, place) for place in batch.places)
        self._transport.write(message)

    def stop(self) -> None:
        """End the process, whatever it is doing; it holds nothing that would be lost."""
        self._transport.abort()
        self._process.kill()
        self._process.wait()

    def data_received(self, data: bytes) -> None:
        """Take what frames are complete; asyncio calls this."""
        self._buffer += data
        header = worker.HEADER.size
        while len(self._buffer) >= header:
            end = header + worker.HEADER.unpack_from(self._buffer)[0]
            if len(self._buffer) < end:
                return
            message = pickle.loads(self._buffer[header:end])
            del self._buffer[:end]
            if isinstance(message, Ready) and message.fault is None:
                self._ready.set_result(None)
            elif isinstance(message, Ready):
                self._ready.set_exception(PoolError(f"a solver worker could not start\n{message.fault}"))
            else:
                self.owes.popleft()
                self._answered(message)

    def connection_lost(self, _error: Exception | None) -> None:
        """The process is gone; asyncio calls this."""
        self.alive = False
        if self._ready.done():
            self._lost(self)
        else:
            self._ready.set_exception(PoolError("a solver worker ended before it was ready"))
