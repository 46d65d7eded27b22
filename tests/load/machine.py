"""How fast the processor works while something else is measured, from instant to instant.

A processor that others use too, or that is made to slow down, works at a tenth of its speed for tens of milliseconds,
and its system does not see it: no load, no time stolen. Whatever runs then takes ten times as long. So the same small
job is done over and over beside the measurement, and what was measured while the job took its time is told apart.
"""

from __future__ import annotations

import os
import statistics
import time
from bisect import bisect_left
from dataclasses import dataclass, field

from beside import Beside

PERIOD_S, PIECES = 0.01, 1_200
"""How often the job is done, and so many steps of Python long: a tenth of a millisecond, one hundredth of a core."""
SLOW = 2.0
"""A job that takes this many times its median is one that the core was slow for."""


@dataclass
class Pace(Beside):
    """Does the job on one core.

    `at_s` is when each began, on the monotonic clock, `took_s` the processor time it took: a job that waits for the
    core, because what is measured has it, is not slow.
    """

    core: int
    at_s: list[float] = field(default_factory=list)
    took_s: list[float] = field(default_factory=list)
    every_s: float = PERIOD_S

    def begin(self) -> None:
        """Stay on the core."""
        os.sched_setaffinity(0, {self.core})

    def look(self) -> None:
        """Do the job once."""
        at_s, began_s = time.perf_counter(), time.thread_time()
        _job()
        self.took_s.append(time.thread_time() - began_s)
        self.at_s.append(at_s)

    def slow(self) -> list[bool]:
        """Which of the jobs the core was slow for."""
        most_s = SLOW * statistics.median(self.took_s) if self.took_s else 0.0
        return [took_s > most_s for took_s in self.took_s]

    def at_speed(self, spans: list[tuple[float, float]]) -> list[bool]:
        """Whether no job was slow from the one before each (begin, end), s, to the one after it."""
        slow, verdicts = self.slow(), []
        for begin_s, end_s in spans:
            first = max(0, bisect_left(self.at_s, begin_s) - 1)
            verdicts.append(not any(slow[first : bisect_left(self.at_s, end_s) + 1]))
        return verdicts


def cores() -> list[int]:
    """Those that this process may use."""
    return sorted(os.sched_getaffinity(0))


def _job() -> int:
    total = 0
    for k in range(PIECES):
        total += k * k
    return total
