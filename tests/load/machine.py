"""How fast the processor works while something else is measured, from instant to instant.

A processor that others use too, or that is made to slow down, works at a tenth of its speed for tens of milliseconds,
and its system does not see it: no load, no time stolen. Whatever runs then takes ten times as long. So the same small
job is done over and over beside the measurement, and what was measured while the job took its time is told apart.
"""

from __future__ import annotations

import statistics
import threading
import time
from bisect import bisect_left
from dataclasses import dataclass, field

PERIOD_S, PIECES = 0.01, 1_200
"""How often the job is done, and so many steps of Python long: a tenth of a millisecond, one hundredth of a core."""
SLOW = 2.0
"""A job that takes this many times its median is one that the processor was slow for."""


@dataclass
class Pace:
    """Does the job on a thread of its own until it is told to stop.

    `at_s` is when each began, on the monotonic clock, `took_s` the processor time it took: a job that waits for the
    core, because what is measured has it, is not slow.
    """

    at_s: list[float] = field(default_factory=list)
    took_s: list[float] = field(default_factory=list)
    _done: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Pace:
        self._thread = threading.Thread(target=self._keep)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _keep(self) -> None:
        while not self._done.wait(PERIOD_S):
            at_s, began_s = time.perf_counter(), time.thread_time()
            _job()
            self.took_s.append(time.thread_time() - began_s)
            self.at_s.append(at_s)

    @property
    def slow_percent(self) -> float:
        """The share of jobs that the processor was slow for."""
        slow = self._slow()
        return round(100.0 * sum(slow) / len(slow), 1) if slow else 0.0

    def at_speed(self, spans: list[tuple[float, float]]) -> list[bool]:
        """Whether no job was slow from the one before each (begin, end), s, to the one after it."""
        slow, verdicts = self._slow(), []
        for begin_s, end_s in spans:
            first = max(0, bisect_left(self.at_s, begin_s) - 1)
            verdicts.append(not any(slow[first : bisect_left(self.at_s, end_s) + 1]))
        return verdicts

    def _slow(self) -> list[bool]:
        most_s = SLOW * statistics.median(self.took_s) if self.took_s else 0.0
        return [took_s > most_s for took_s in self.took_s]


def _job() -> int:
    total = 0
    for k in range(PIECES):
        total += k * k
    return total
