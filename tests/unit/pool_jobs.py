"""Jobs that worker processes of the pool tests can be asked to do; what blocks, blocks on a FIFO."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any


def solve(job: tuple[Any, ...]) -> Any:
    """Do the job named first with what comes second; a weight may come third."""
    kind, value = job[:2]
    return JOBS[kind](value)


def _wait(fifo: str) -> str:
    """Until somebody has written to the FIFO; returns what."""
    return Path(fifo).read_text(encoding="utf-8")


def _hold(fifo: str) -> None:
    """Tell the process id to whoever reads the FIFO, and never end."""
    Path(fifo).write_text(str(os.getpid()), encoding="utf-8")
    signal.pause()


def _hold_once(fifo: str) -> str:
    """As `hold` on the first try; on the next, what a job gives that was tried again."""
    try:
        os.close(os.open(fifo + ".tried", os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return "again"
    return _hold(fifo) or ""


def _touch(path: str) -> str:
    Path(path).touch()
    return "touched"


def _die(_: None) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fail(text: str) -> None:
    raise RuntimeError(text)


JOBS = {
    "echo": lambda value: value,
    "process": lambda _: (os.getpid(), os.getpgid(0)),
    "wait": _wait,
    "hold": _hold,
    "hold_once": _hold_once,
    "touch": _touch,
    "die": _die,
    "fail": _fail,
}
