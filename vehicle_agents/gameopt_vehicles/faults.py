"""Seeded faults at the message boundary: loss, delay and jitter, in simulated and in wall time alike."""

from __future__ import annotations

import heapq
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")

NOW_S = 1e-6
"""A message due this much later is due: times on the 0.1 s grid are sums of floats."""


class Faults(Generic[T]):
    """A channel that loses and delays messages; without faults it hands them on in order.

    Each message is lost with probability `loss`, else delivered after `delay_s` plus a uniform share of
    +- `jitter_s` (never before it was sent), so messages overtake each other when jitter allows it.
    """

    def __init__(self, seed: int | list[int], loss: float = 0.0, delay_s: float = 0.0, jitter_s: float = 0.0) -> None:
        self._random = np.random.default_rng(seed)
        self._loss = loss
        self._delay_s = delay_s
        self._jitter_s = jitter_s
        self._queue: list[tuple[float, int, T]] = []
        self._pushed = 0
        self.lost = 0

    def push(self, time_s: float, message: T) -> None:
        """Send `message` at `time_s`."""
        self._pushed += 1
        if self._loss > 0.0 and self._random.random() < self._loss:
            self.lost += 1
            return
        delay_s = self._delay_s
        if self._jitter_s > 0.0:
            delay_s += self._jitter_s * self._random.uniform(-1.0, 1.0)
        heapq.heappush(self._queue, (time_s + max(0.0, delay_s), self._pushed, message))

    def due(self, time_s: float) -> list[T]:
        """The messages that have arrived by `time_s`, in the order of their arrival."""
        arrived: list[T] = []
        while self._queue and self._queue[0][0] <= time_s + NOW_S:
            arrived.append(heapq.heappop(self._queue)[2])
        return arrived

    def next_due_s(self) -> float | None:
        """When the next message under way arrives; None when there is none."""
        return self._queue[0][0] if self._queue else None
