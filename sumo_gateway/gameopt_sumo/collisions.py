"""The independent check: do the bodies of two vehicles ever overlap?

It knows nothing but poses and sizes as the simulator gives them, and builds its own rectangles; it shares no
code with the map, the planner or the messages, so that it cannot share their mistakes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt
import shapely

Floats = npt.NDArray[np.float64]

SUBSTEPS = 5
"""Poses looked at per simulation step of 0.1 s: every 20 ms."""
JUMP_M = 15.0
"""A vehicle that moved further in one step was put there, it did not drive."""
_TOUCH_M = 1e-6
"""Bodies that only touch do not overlap."""


class Placed(Protocol):
    """A vehicle's front bumper centre, SUMO angle (degrees clockwise from north) and size."""

    @property
    def vehicle(self) -> str: ...
    @property
    def x_m(self) -> float: ...
    @property
    def y_m(self) -> float: ...
    @property
    def angle_deg(self) -> float: ...
    @property
    def length_m(self) -> float: ...
    @property
    def width_m(self) -> float: ...


class OverlapCheck:
    """Counts distinct pairs of vehicles whose bodies overlapped at any 20 ms instant."""

    def __init__(self, inflate_m: float = 0.0) -> None:
        """`inflate_m` grows every body all round: with it the check finds near misses."""
        self._inflate_m = inflate_m
        self._before: dict[str, Floats] = {}
        self.pairs: dict[tuple[str, str], int] = {}
        """Every overlapping pair, with the number of the step it was first seen in."""
        self.steps = 0

    def step(self, poses: Sequence[Placed]) -> list[tuple[str, str]]:
        """Look at one more step; the pairs that overlapped for the first time."""
        self.steps += 1
        now = _ends(poses)
        names = [pose.vehicle for pose in poses]
        found = self._search(names, poses, now) if len(poses) > 1 else []
        self._before = dict(zip(names, now, strict=True))
        for pair in found:
            self.pairs[pair] = self.steps
        return found

    def _search(self, names: list[str], poses: Sequence[Placed], now: Floats) -> list[tuple[str, str]]:
        before = np.array([self._before.get(name, ends) for name, ends in zip(names, now, strict=True)])
        moved = np.hypot(*(now[:, 0] - before[:, 0]).T)
        before[moved > JUMP_M] = now[moved > JUMP_M]
        moved[moved > JUMP_M] = 0.0
        size = np.array([(pose.length_m, pose.width_m) for pose in poses])
        size += 2.0 * (self._inflate_m - _TOUCH_M)
        first, second = _near(now, size, moved)
        if first.size == 0:
            return []
        # Rows are substeps, columns vehicles that have anybody near.
        involved, column = np.unique(np.concatenate((first, second)), return_inverse=True)
        share = (np.arange(1, SUBSTEPS + 1) / SUBSTEPS)[:, None, None, None]
        ends = before[involved] + share * (now[involved] - before[involved])
        shapes = _rectangles(ends, size[involved], self._inflate_m)
        hit = shapely.intersects(shapes[:, column[: first.size]], shapes[:, column[first.size :]]).any(axis=0)
        pairs = (sorted((names[i], names[j])) for i, j in zip(first[hit], second[hit], strict=True))
        return [(a, b) for a, b in pairs if (a, b) not in self.pairs]


def _ends(poses: Sequence[Placed]) -> Floats:
    """Front and rear bumper centres, (n, 2, 2)."""
    values = np.array([(p.x_m, p.y_m, p.angle_deg, p.length_m) for p in poses]).reshape(-1, 4)
    angle = np.radians(values[:, 2])
    heading = np.stack((np.sin(angle), np.cos(angle)), axis=1)
    front = values[:, :2]
    return np.stack((front, front - heading * values[:, 3:]), axis=1)


def _near(now: Floats, size: Floats, moved: Floats) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Index pairs whose bodies might have touched on the way: circles round them, grown by the way made."""
    centre = now.mean(axis=1)
    reach = 0.5 * np.hypot(size[:, 0], size[:, 1]) + moved
    dx = centre[:, None, 0] - centre[None, :, 0]
    dy = centre[:, None, 1] - centre[None, :, 1]
    near = dx * dx + dy * dy <= (reach[:, None] + reach[None, :]) ** 2
    first, second = np.nonzero(np.triu(near, k=1))
    return first, second


def _rectangles(ends: Floats, size: Floats, inflate_m: float) -> npt.NDArray[np.object_]:
    """Bodies (substeps, vehicles) from the front bumper back along the line between both ends."""
    front, rear = ends[..., 0, :], ends[..., 1, :]
    axis = front - rear
    along = axis / np.maximum(np.hypot(axis[..., 0], axis[..., 1]), 1e-9)[..., None]
    across = np.stack((-along[..., 1], along[..., 0]), axis=-1) * (0.5 * size[:, 1])[:, None]
    tip = front + along * (inflate_m - _TOUCH_M)
    tail = tip - along * size[:, 0][:, None]
    corners = np.stack((tip + across, tip - across, tail - across, tail + across), axis=-2)
    return np.asarray(shapely.polygons(corners), dtype=np.object_)
