"""How long the stages of a control cycle take, as histograms: cheap to add to, and safe to read at any moment."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

BOUNDS_S = (
    *(0.0001, 0.0002, 0.0005, 0.001, 0.002, 0.003, 0.004, 0.005, 0.0075, 0.01, 0.0125, 0.015, 0.02, 0.025),
    *(0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.5, 1.0),
)
"""Finest where the targets for control cycles lie, 5 to 25 ms."""


class Histogram(NamedTuple):
    """`counts[i]` observations in (bounds[i-1], bounds[i]], the last one above all bounds; `sum` of all, s."""

    bounds: tuple[float, ...]
    counts: tuple[int, ...]
    sum: float


class Stages:
    """A histogram a stage, from the start of the manager."""

    def __init__(self) -> None:
        self._counts: dict[str, list[int]] = {}
        self._sums: dict[str, float] = {}

    def observe(self, stage: str, seconds: float) -> None:
        """A stage has taken this long."""
        counts = self._counts.get(stage)
        if counts is None:
            counts = self._counts[stage] = [0] * (len(BOUNDS_S) + 1)
            self._sums[stage] = 0.0
        counts[bisect_left(BOUNDS_S, seconds)] += 1
        self._sums[stage] += seconds

    def snapshot(self) -> dict[str, Histogram]:
        """All stages so far, in the order in which they first ended."""
        return {stage: Histogram(BOUNDS_S, tuple(counts), self._sums[stage]) for stage, counts in self._counts.items()}
