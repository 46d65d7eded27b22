"""The programs of a run as processes of their own, all of which can be ended at once."""

from __future__ import annotations

import os
import platform
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec

BIN = Path(sys.executable).parent
"""Where the commands of this installation are."""
MANAGER_LOG, VEHICLES_LOG = "manager.log", "vehicles.log"
STOP_S = 30.0
"""A process that has not ended this long after it was asked to is killed."""


class ProcessError(Exception):
    """A program could not do what it was started for; one line."""


class Stopped(Exception):  # noqa: N818 - not an error: somebody asked for it
    """The comparison is over: nothing more is started."""


class Ran(NamedTuple):
    """Manager and vehicles, when both are over: the manager's process id, the vehicles' exit code."""

    manager_pid: int
    code: int


class Serving(NamedTuple):
    """A manager at work: its process id, and where it listens."""

    pid: int
    endpoint: str


class Processes:
    """Starts programs and, asked to stop, ends all that still run. Safe from several threads.

    Programs that are `apart` do not hear Ctrl-C themselves: whoever started them ends them, by `stop`.
    """

    def __init__(self, apart: bool = False) -> None:
        self._apart = apart
        self._lock = threading.RLock()  # a signal's handler may come while it is held
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def stop(self) -> None:
        """End every program; whoever waits for one, or starts another, gets `Stopped`."""
        with self._lock:
            self._stopped = True
            running = list(self._running)
        for process in running:
            if self._apart and process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)  # with whatever it has started itself
            else:
                process.terminate()

    def run(self, command: Sequence[Any], log: Path) -> int:
        """A program from start to end, its output in `log`; the exit code. Raises `Stopped`."""
        with log.open("w") as said, self._started(command, stdout=said, stderr=subprocess.STDOUT) as process:
            return self._ended(process)

    def two(self, serve: Sequence[Any], drive: Sequence[Any], folder: Path) -> Ran:
        """`gameopt-im serve` and `gameopt-vehicles` with these options, over Zenoh on a port of their own.

        Their logs go to `folder`. Raises `ProcessError` if the manager does not serve, or not to the end, and
        `Stopped`.
        """
        with self.serving(serve, folder) as manager:
            code = self.drive(manager.endpoint, drive, folder)
        return Ran(manager.pid, code)

    @contextmanager
    def serving(self, serve: Sequence[Any], folder: Path) -> Iterator[Serving]:
        """`gameopt-im serve` on a port of its own, ended when the context is left; raises as `two` does."""
        endpoint = f"tcp/127.0.0.1:{_free_port()}"
        command = [BIN / "gameopt-im", "serve", "--listen", endpoint, "--http", "off", *serve]
        with (
            (folder / MANAGER_LOG).open("w") as log,
            self._started(command, stdout=log, stderr=subprocess.PIPE) as manager,
        ):
            assert manager.stderr is not None
            self._await_serving(manager.stderr, log)
            rest = threading.Thread(target=log.writelines, args=[manager.stderr])
            rest.start()
            try:
                yield Serving(manager.pid, endpoint)
            finally:
                _end(manager)
                rest.join()
        self.check()  # whoever was asked to stop may have ended in any way
        if manager.returncode != 0:
            raise ProcessError(
                f"the manager ended with exit code {manager.returncode}: {last_line(folder / MANAGER_LOG)}"
            )

    def drive(self, endpoint: str, drive: Sequence[Any], folder: Path) -> int:
        """`gameopt-vehicles` with the manager there, from start to end; the exit code. Raises `Stopped`."""
        return self.run([BIN / "gameopt-vehicles", "--connect", endpoint, *drive], folder / VEHICLES_LOG)

    def _await_serving(self, lines: IO[str], log: IO[str]) -> None:
        last = "the manager ended before it served"
        for line in lines:
            log.write(line)
            if "serving" in line:
                return
            last = line.strip() or last
        self.check()
        raise ProcessError(last)

    @contextmanager
    def _started(self, command: Sequence[Any], **streams: Any) -> Iterator[subprocess.Popen[str]]:
        with self._lock:
            self.check()
            process = subprocess.Popen(
                [str(word) for word in command],
                stdin=subprocess.DEVNULL,
                text=True,
                process_group=0 if self._apart else None,
                **streams,
            )
            self._running.add(process)
        try:
            yield process
        finally:
            _end(process)
            if process.stderr is not None:
                process.stderr.close()
            with self._lock:
                self._running.discard(process)

    def _ended(self, process: subprocess.Popen[str]) -> int:
        code = process.wait()
        self.check()
        return code

    def check(self) -> None:
        """Raises `Stopped`, once it is."""
        if self._stopped:
            raise Stopped


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Machine(msgspec.Struct, frozen=True):
    """What times were taken on, and how many runs at a time it had."""

    processor: str
    """By its name, as far as the system tells it."""
    cores: int
    jobs: int


def machine(jobs: int = 1) -> Machine:
    """This one."""
    return Machine(_processor(), cores(), jobs)


def _processor() -> str:
    cpus = Path("/proc/cpuinfo")  # Linux; elsewhere Python asks the system
    named = re.search(r"^model name\s*:\s*(.+)$", cpus.read_text(), re.MULTILINE) if cpus.exists() else None
    return named[1] if named else platform.processor() or platform.machine()


def last_line(*logs: Path) -> str:
    """The last thing said in the first of these logs that says anything."""
    for log in logs:
        lines = [line.strip() for line in log.read_text(errors="replace").splitlines()] if log.exists() else []
        if said := [line for line in lines if line]:
            return said[-1]
    return "it said nothing"


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
