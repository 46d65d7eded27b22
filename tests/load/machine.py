"""How fast the processor works while something else is measured, from instant to instant.

A processor that others use too, or that is made to slow down, works at a tenth of its speed for tens of milliseconds,
and its system does not see it: no load, no time stolen. Whatever runs then takes ten times as long. So a fixed quantum
of work is done over and over beside the measurement, as tests of a system's noise do (FWQ), and what was measured while
it took longer is told apart.
"""

from __future__ import annotations

import os
import statistics
import time
from bisect import bisect_left
from dataclasses import dataclass, field

from beside import Beside

PERIOD_S, QUANTUM = 0.01, 1_200
"""How often the quantum is done, and so many steps of Python long: a tenth of a millisecond, a hundredth of a core."""
SLOW = 2.0
"""A quantum that takes more than this many times its median is one that the core was slow for."""


@dataclass
class FixedWork(Beside):
    """Does the quantum on one core.

    `at_s` is when each began, on the monotonic clock, `took_s` the processor time it took: one that waits for the core,
    because what is measured has it, is not slow.
    """

    core: int
    at_s: list[float] = field(default_factory=list)
    took_s: list[float] = field(default_factory=list)
    every_s: float = PERIOD_S

    def look(self) -> None:
        """Do the quantum once."""
        at_s, began_s = time.perf_counter(), time.thread_time()
        _quantum()
        self.took_s.append(time.thread_time() - began_s)
        self.at_s.append(at_s)

    def _keep(self) -> None:
        os.sched_setaffinity(0, {self.core})  # of this thread alone
        super()._keep()

    def slow(self) -> list[bool]:
        """Which of the quanta the core was slow for."""
        most_s = SLOW * statistics.median(self.took_s) if self.took_s else 0.0
        return [took_s > most_s for took_s in self.took_s]

    def at_speed(self, spans: list[tuple[float, float]]) -> list[bool]:
        """Whether no quantum was slow from the one before each (begin, end), s, to the one after it.

        Where there is none before, or none after, nobody knows: False.
        """
        slow, verdicts = self.slow(), []
        for begin_s, end_s in spans:
            before, after = bisect_left(self.at_s, begin_s) - 1, bisect_left(self.at_s, end_s)
            verdicts.append(before >= 0 and after < len(slow) and not any(slow[before : after + 1]))
        return verdicts


def cores() -> list[int]:
    """Those that this process may use."""
    return sorted(os.sched_getaffinity(0))


def _quantum() -> int:
    total = 0
    for k in range(QUANTUM):
        total += k * k
    return total
