"""What a running manager knows of itself, for whoever watches it: plain numbers, added to once a control cycle.

Nothing here costs the control cycle more than a few additions; whatever is made of the numbers is made by the
reader, when it reads.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Final

from gameopt_im.manager import Outcome
from gameopt_im.solver.pool import Counts
from gameopt_im.stages import Stages
from gameopt_wire.messages import Clock, CycleReport

WHOLE = "whole"
"""The stage that is all of them: the whole way of a control cycle (`whole_way`)."""
STALLED_S = 1.0
"""Wall clock: a loop that ended its last control cycle longer ago than this does not run."""
STUCK_S = 10.0
"""Lock-step, which waits for simulators but not for itself: vehicles give up on a control cycle longer than this."""
BUSY_S = 0.5
"""Longest wait for a control cycle to end."""

_NOTHING: Final = CycleReport(
    term=0, cycle=0, time_s=0.0, vehicles=0, uncleared=0, cleared=0, commands=0, candidates=0, selected=-2, order=[],
    granted=[], delay_s=0.0, elapsed_ms=0.0, stages_ms={}, qp_solved_total=0, qp_failed_total=0, qp_late_total=0,
    missed_total=0, received_total=0, rejected_total={}, fallback=0, silent=0,
)  # fmt: skip


class Vitals:
    """The counters of one manager, and whether it is well; `now` is a monotonic clock, s."""

    def __init__(self, clock: Clock, now: Callable[[], float] = time.monotonic) -> None:
        self.stages = Stages()
        self.report = _NOTHING
        """That of the last control cycle; its own totals run from the start of the term."""
        self.programs = Counts()
        """The solver's own, once there is one."""
        self.control_cycles = 0
        self.commands = 0
        self.bids = 0
        self.grants = 0
        self.refusals = 0
        self.withdrawals = 0
        self.crossings = 0
        self.candidates = 0
        self.fallback_vehicle_cycles = 0
        self.announced = False
        """Whether vehicles can find the manager: its workers are warm, and it is declared on Zenoh."""
        self._clock = clock
        self._now = now
        self._turned_s = now()
        self._idle = asyncio.Event()
        self._idle.set()

    def announce(self) -> None:
        """The manager can be found from now on, and its control cycles begin."""
        self.announced = True
        self._turned_s = self._now()

    def cycle_begun(self) -> None:
        """A control cycle begins."""
        self._idle.clear()
        self._turned_s = self._now()

    def cycle_done(self, outcome: Outcome, bids: int) -> None:
        """A control cycle has ended, its messages are with Zenoh; `bids` taken since the start."""
        report = outcome.report
        now_s = self._now()
        if report.whole_ms is not None:
            self.stages.observe(WHOLE, 1e-3 * report.whole_ms)
        for stage, elapsed_ms in report.stages_ms.items():
            self.stages.observe(stage, 1e-3 * elapsed_ms)
        self.report = report
        self.bids = bids
        self.control_cycles += 1
        self.commands += report.commands
        self.grants += len(report.granted)
        self.refusals += report.refused
        self.withdrawals += report.withdrawn
        self.candidates += report.candidates
        self.fallback_vehicle_cycles += report.fallback
        for entry in outcome.ledger:
            self.crossings += entry.left_s is not None
        self._turned_s = now_s
        self._idle.set()

    async def between_cycles(self) -> None:
        """Returns when no control cycle is under way, so that what is done then does not make one longer.

        Or after `BUSY_S`: a control cycle that does not end has to be seen from outside.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(BUSY_S):
                await self._idle.wait()

    def ailment(self) -> str | None:
        """Why the manager is not well, in words; None if it is."""
        if not self.announced:
            return None  # nothing is expected of it yet
        age_s = self._now() - self._turned_s
        if self._clock == "wall" and age_s > STALLED_S:
            return f"no control cycle for {age_s:.1f} s"
        if not self._idle.is_set() and age_s > STUCK_S:
            return f"a control cycle has been under way for {age_s:.1f} s"
        return None
