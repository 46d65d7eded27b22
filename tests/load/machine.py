"""How evenly this machine works when nothing but one small job runs: what it adds to the p99 of a service."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

PERIOD_S, PIECES = 0.1, 40_000
"""A job as often as a control cycle begins, and so many steps of Python long: a few milliseconds."""


@dataclass(frozen=True)
class Evenness:
    """How long the same job took, time after time."""

    p50_ms: float
    p99_ms: float


def evenness(seconds: float) -> Evenness:
    """Does the same job ten times a second for so long."""
    taken_ms = []
    due_s = time.perf_counter()
    for _ in range(round(seconds / PERIOD_S)):
        due_s += PERIOD_S
        time.sleep(max(0.0, due_s - time.perf_counter()))
        began_s = time.perf_counter()
        _job()
        taken_ms.append(1e3 * (time.perf_counter() - began_s))
    cuts = statistics.quantiles(taken_ms, n=100, method="inclusive")
    return Evenness(round(cuts[49], 1), round(cuts[98], 1))


def _job() -> int:
    total = 0
    for k in range(PIECES):
        total += k * k
    return total
