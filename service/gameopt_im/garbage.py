"""Garbage collection between control cycles, never within one: a full collection takes longer than a decision."""

from __future__ import annotations

import gc
from types import TracebackType

EVERY_CYCLES = 50
"""Control cycles from one collection to the next: what they leave in reference cycles is little."""


class BetweenCycles:
    """While this context is open, garbage is collected only when `cycle_done` finds that it is time."""

    def __init__(self) -> None:
        self._cycles = 0
        self._enabled = True

    def __enter__(self) -> BetweenCycles:
        self._enabled = gc.isenabled()
        gc.collect()
        gc.freeze()  # what stands now stands for good: later collections need not look at it
        gc.disable()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        gc.unfreeze()
        if self._enabled:
            gc.enable()

    def cycle_done(self) -> None:
        """A control cycle has ended and its commands are out."""
        self._cycles += 1
        if self._cycles % EVERY_CYCLES == 0:
            gc.collect()
