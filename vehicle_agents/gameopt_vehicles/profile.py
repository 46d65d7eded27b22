"""An accepted clearance as a function of time: where the vehicle should be, and how fast. Pure."""

from __future__ import annotations

from itertools import accumulate, pairwise

from gameopt_wire.messages import STEP_S, Clearance

GRID = 1e-5
"""Fraction of a step within which a time is on the profile's grid: epoch seconds round to 2.4e-6 of one."""


class SpeedProfile:
    """Speeds at `start_s + k * STEP_S`, linear in between (a ballistic step); constant beyond the end."""

    def __init__(self, clearance: Clearance) -> None:
        self._start_s = clearance.start_s
        self._speeds = clearance.speeds_mps
        ways = (0.5 * STEP_S * (a + b) for a, b in pairwise(self._speeds))
        self._covered = list(accumulate(ways, initial=0.0))

    def ended(self, time_s: float) -> bool:
        """Whether there is no speed left to reach after `time_s`."""
        return self._position(time_s)[0] >= len(self._speeds) - 1

    def speed_mps(self, time_s: float) -> float:
        """The speed to have at `time_s`."""
        k, part = self._position(time_s)
        speed = self._speeds[k]
        return speed if part == 0.0 else speed + part * (self._speeds[k + 1] - speed)

    def covered_m(self, time_s: float) -> float:
        """The way from `start_s` to `time_s`."""
        k, part = self._position(time_s)
        if k == len(self._speeds) - 1:
            beyond_s = time_s - self._start_s - k * STEP_S
            return self._covered[k] + max(0.0, beyond_s) * self._speeds[k]
        return self._covered[k] + 0.5 * STEP_S * part * (self._speeds[k] + self.speed_mps(time_s))

    def _position(self, time_s: float) -> tuple[int, float]:
        """Index of the last grid point at or before `time_s`, and the fraction of a step since then."""
        steps = max(0.0, (time_s - self._start_s) / STEP_S)
        k = int(steps + 0.5)
        if abs(steps - k) > GRID:
            k = int(steps)
        if k >= len(self._speeds) - 1:
            return len(self._speeds) - 1, 0.0
        part = steps - k
        return k, part if part > GRID else 0.0
