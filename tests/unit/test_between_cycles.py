"""Garbage is left alone while a control cycle is decided."""

from __future__ import annotations

import gc
import weakref

from gameopt_im.garbage import EVERY_CYCLES, BetweenCycles


class Loop:
    """Something that only the collector frees."""

    def __init__(self) -> None:
        self.itself = self


def test_garbage_is_collected_between_cycles_only() -> None:
    with BetweenCycles() as garbage:
        assert not gc.isenabled()
        left = weakref.ref(Loop())
        for _ in range(EVERY_CYCLES - 1):
            garbage.cycle_done()
        assert left() is not None
        garbage.cycle_done()
        assert left() is None
    assert gc.isenabled()


def test_one_within_another_changes_nothing() -> None:
    with BetweenCycles():
        with BetweenCycles():
            pass
        assert not gc.isenabled()
