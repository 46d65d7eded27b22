"""Many times, in little memory: how they spread is known to a tenth of a millisecond, however long the run."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from itertools import accumulate

import msgspec

PER_S = 10_000
"""Buckets a second: 0.1 ms each."""
MOST = 10 * PER_S
"""Times from 10 s up share one bucket, so memory is bounded; the largest is kept as it was."""


class Spread(msgspec.Struct, kw_only=True):
    """How times spread, ms."""

    p50_ms: float
    p99_ms: float
    p999_ms: float
    max_ms: float


class Timings:
    """Times one by one, as a histogram."""

    def __init__(self) -> None:
        self.count = 0
        self._buckets: Counter[int] = Counter()
        self._max_s = 0.0

    def observe(self, seconds: float) -> None:
        """One more; one below zero, by two clocks, counts as zero."""
        self.count += 1
        self._buckets[min(MOST, int(max(0.0, seconds) * PER_S))] += 1
        self._max_s = max(self._max_s, seconds)

    def spread(self) -> Spread | None:
        """None of none."""
        if self.count == 0:
            return None
        p50, p99, p999 = (self._percentile(share) for share in (0.5, 0.99, 0.999))
        return Spread(p50_ms=p50, p99_ms=p99, p999_ms=p999, max_ms=round(1e3 * self._max_s, 3))

    def _percentile(self, share: float) -> float:
        """The smallest bucket's upper end, ms, that this share of the times does not exceed; the largest at most."""
        buckets = sorted(self._buckets)
        so_far = accumulate(self._buckets[bucket] for bucket in buckets)
        bucket = buckets[bisect_left(list(so_far), math.ceil(share * self.count))]
        return round(1e3 * min((bucket + 1) / PER_S, self._max_s), 3)
