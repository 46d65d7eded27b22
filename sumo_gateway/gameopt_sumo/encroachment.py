"""Post-encroachment time: how long after one vehicle has left a piece of ground the next one comes onto it.

The conflict zone is cut into square cells. A cell counts as covered while its centre is under a body; when
the front reached it and when the rear leaves it follow from the distance to either bumper and the speed, so
the times are finer than the simulation step. Poses and sizes come from the simulator.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

from gameopt_sumo.observation import STEP_S, Pose

CELL_M = 0.5
_NOBODY = -1


class Encroachment:
    """Keeps, per cell, who left it last and when; `least_s` is the smallest time found so far."""

    def __init__(self, conflict_zone: Sequence[tuple[float, float]]) -> None:
        """`conflict_zone` is the outline of the junction."""
        outline = shapely.Polygon(conflict_zone).buffer(0)
        x0, y0, x1, y1 = outline.bounds
        x, y = np.meshgrid(np.arange(x0, x1, CELL_M), np.arange(y0, y1, CELL_M))
        inside = shapely.contains_xy(outline, x, y)
        self._x, self._y = x[inside], y[inside]
        self._bounds = (x0, y0, x1, y1)
        self._last = np.full(self._x.size, _NOBODY, dtype=np.int64)
        self._left_s = np.full(self._x.size, -np.inf)
        self._numbers: dict[str, int] = {}
        self._lanes: list[int] = []
        self.least_s: float | None = None

    def step(self, time_s: float, poses: Sequence[Pose], lanes: dict[str, int]) -> None:
        """One step; `lanes` has the approach lane each vehicle came from: followers do not count."""
        x0, y0, x1, y1 = self._bounds
        for pose in poses:
            reach = pose.length_m
            inside = x0 - reach < pose.x_m < x1 + reach and y0 - reach < pose.y_m < y1 + reach
            if inside and pose.vehicle in lanes:
                self._cover(time_s, pose, lanes[pose.vehicle])

    def _cover(self, time_s: float, pose: Pose, lane: int) -> None:
        number = self._number(pose.vehicle, lane)
        angle = np.radians(pose.angle_deg)
        sin, cos = float(np.sin(angle)), float(np.cos(angle))
        dx, dy = self._x - pose.x_m, self._y - pose.y_m
        behind_front = -(dx * sin + dy * cos)
        aside = np.abs(dx * cos - dy * sin)
        under = (behind_front >= 0.0) & (behind_front <= pose.length_m) & (aside <= 0.5 * pose.width_m)
        cells: npt.NDArray[np.intp] = np.flatnonzero(under)
        if cells.size == 0:
            return
        speed = max(pose.speed_mps, 1e-3)
        others = self._last[cells]
        fresh = (others != _NOBODY) & (others != number)
        if fresh.any():
            strangers = cells[fresh]
            lanes = np.asarray(self._lanes)[self._last[strangers]]
            strangers = strangers[lanes != lane]
            if strangers.size:
                came_s = time_s - np.minimum(STEP_S, behind_front[strangers] / speed)
                least = max(0.0, float((came_s - self._left_s[strangers]).min()))
                self.least_s = least if self.least_s is None else min(self.least_s, least)
        self._last[cells] = number
        to_rear = pose.length_m - behind_front[cells]
        self._left_s[cells] = time_s + np.minimum(STEP_S, to_rear / speed)

    def _number(self, vehicle: str, lane: int) -> int:
        number = self._numbers.get(vehicle)
        if number is None:
            number = self._numbers[vehicle] = len(self._lanes)
            self._lanes.append(lane)
        return number
