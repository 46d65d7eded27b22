"""A worker process of `pool.Pool`: takes batches of jobs from a socket, answers each job as it is done.

Frames on the socket are a length (8 bytes, big-endian) and a pickle. The first one to the worker is a
`Start`, answered by a `Ready`; then come `Batch`es, each job of which is answered by an `Answer`. At the end
of the stream, which is also what a dead parent looks like, the worker leaves.
"""

from __future__ import annotations

import pickle
import signal
import socket
import struct
import time
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

from gameopt_im import scheduling
from gameopt_im.garbage import BetweenCycles

HEADER = struct.Struct(">Q")


class Start(NamedTuple):
    """What to solve with, the jobs to warm up on, and whether to go before other processes, if that is allowed."""

    solve: str
    warm_up: Sequence[Any]
    go_first: bool = False


class Ready(NamedTuple):
    """The worker has warmed up, or why it could not: a traceback."""

    fault: str | None


class Batch(NamedTuple):
    """Jobs of one call, with their places in it; none is begun after `until_s` of the monotonic clock."""

    number: int
    until_s: float | None
    places: Sequence[int]
    jobs: Sequence[Any]


class Answer(NamedTuple):
    """What became of one job: its result, None where there is none, or the traceback of what it raised."""

    number: int
    place: int
    result: Any
    fault: str | None
    begun: bool


def frame(message: object) -> bytes:
    """A message as it goes over the socket."""
    payload = pickle.dumps(message, protocol=5)
    return HEADER.pack(len(payload)) + payload


def load(path: str) -> Callable[[Any], Any]:
    """The function behind `package.module:name`."""
    module, _, name = path.partition(":")
    function: Callable[[Any], Any] = getattr(import_module(module), name)
    return function


def run(solve: Callable[[Any], Any], job: Any) -> tuple[Any, str | None]:
    """(result, None), or (None, traceback): a job at fault costs itself, not its batch nor the process."""
    try:
        return solve(job), None
    except Exception:  # noqa: BLE001 - whatever it is, it is told to the pool, which counts and logs it
        return None, traceback.format_exc()


def prepare(start: Start) -> Callable[[Any], Any]:
    """The function to solve with, once it has solved the jobs to warm up on."""
    solve = load(start.solve)
    for job in start.warm_up:
        solve(job)
    return solve


def main(descriptor: int) -> None:
    """Serve batches on the socket inherited as `descriptor` until it closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    with socket.socket(fileno=descriptor) as connection:
        try:
            start = _receive(connection)
            solve, fault = run(prepare, start)
            if start.go_first:
                scheduling.go_first()
            connection.sendall(frame(Ready(fault)))
            with BetweenCycles() as garbage:
                while fault is None:
                    _serve(connection, solve, _receive(connection))
                    garbage.cycle_done()
        except (EOFError, ConnectionError):
            return


def _serve(connection: socket.socket, solve: Callable[[Any], Any], batch: Batch) -> None:
    for place, job in zip(batch.places, batch.jobs, strict=True):
        begun = batch.until_s is None or time.monotonic() < batch.until_s
        result, fault = run(solve, job) if begun else (None, None)
        connection.sendall(frame(Answer(batch.number, place, result, fault, begun)))


def _receive(connection: socket.socket) -> Any:
    (length,) = HEADER.unpack(_read(connection, HEADER.size))
    return pickle.loads(_read(connection, length))


def _read(connection: socket.socket, length: int) -> bytearray:
    buffer = bytearray(length)
    view = memoryview(buffer)
    while view:
        count = connection.recv_into(view)
        if count == 0:
            raise EOFError
        view = view[count:]
    return buffer
