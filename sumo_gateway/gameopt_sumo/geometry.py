"""The ground a movement's body sweeps: its path, the body's pose on it, and where two movements touch.

A body stands as SUMO poses a vehicle: its long axis points along the chord from the front bumper's point on the
path to the rear bumper's, and it is as long as the vehicle, longer than that chord. So on a bend the rear cuts the
corner and the tail swings out, as those of a long vehicle do.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from gameopt_wire.intersection import Footprint

Floats = npt.NDArray[np.float64]
Window = tuple[float, float]

SAMPLE_STEP_M = 0.25
"""Distance between two sampled poses; windows are widened by it, so nothing between two samples is missed."""
UPSTREAM_M = 20.0
"""Sweeping begins this far before the stop line: a turning tail reaches over the lane beside it."""
DOWNSTREAM_M = 20.0
"""Sweeping goes on this far beyond a rear on the exit lane: who turns out of the arm beside may cut over it there."""
BODY_MARGIN_M = 0.3
"""Bodies are grown by this all round before they are swept."""
LANE_SLACK_M = 0.01
"""A body grown sideways stays this far inside its lane, or neighbouring lanes would touch."""
_EXTENSION_M = 100.0


class Track:
    """The centre line of a movement, by distance past its stop line as SUMO counts it.

    SUMO's lane lengths and the lengths of their drawn shapes may differ; positions are scaled lane by lane as
    SUMO does. Before the first and after the last lane the line goes straight on.
    """

    def __init__(self, sections: list[tuple[float, list[tuple[float, float]]]], start_m: float) -> None:
        """`sections` are (length as SUMO counts it, shape) of consecutive lanes, the first begins at
        `start_m`."""
        distances: list[Floats] = []
        points: list[Floats] = []
        offset = start_m
        for length_m, shape in sections:
            xy = np.asarray(shape, dtype=np.float64)
            drawn = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))))
            distances.append(offset + drawn * (length_m / drawn[-1] if drawn[-1] > 0.0 else 0.0))
            points.append(xy)
            offset += length_m
        d, xy = np.concatenate(distances), np.concatenate(points)
        keep = np.concatenate(([True], np.diff(d) > 1e-9))
        d, xy = d[keep], xy[keep]
        before = xy[0] - _direction(xy[1] - xy[0]) * _EXTENSION_M
        after = xy[-1] + _direction(xy[-1] - xy[-2]) * _EXTENSION_M
        self._distance_m = np.concatenate(([d[0] - _EXTENSION_M], d, [d[-1] + _EXTENSION_M]))
        self._xy = np.vstack((before, xy, after))

    def points(self, past_line_m: Floats) -> Floats:
        """Points (n, 2) at the distances (n,) past the stop line, m."""
        x = np.interp(past_line_m, self._distance_m, self._xy[:, 0])
        y = np.interp(past_line_m, self._distance_m, self._xy[:, 1])
        return np.stack((x, y), axis=1)

    def line(self, from_m: float, to_m: float) -> list[tuple[float, float]]:
        """The centre line between two distances past the stop line, with all its bends."""
        inside = self._distance_m[(self._distance_m > from_m) & (self._distance_m < to_m)]
        points = np.round(self.points(np.concatenate(([from_m], inside, [to_m]))), 3)
        fresh = np.concatenate(([True], np.any(np.diff(points, axis=0) != 0.0, axis=1)))
        return [(float(x), float(y)) for x, y in points[fresh]]


def _direction(vector: Floats) -> Floats:
    unit: Floats = vector / np.hypot(*vector)
    return unit


def bodies(track: Track, fronts_m: Floats, length_m: float, width_m: float, side_m: float) -> Floats:
    """Corners (n, 4, 2) of the grown body with its front bumper at `fronts_m` past the stop line."""
    front = track.points(fronts_m)
    axis = front - track.points(fronts_m - length_m)
    norm = np.maximum(np.hypot(axis[:, 0], axis[:, 1]), 1e-9)[:, None]
    along = axis / norm
    across = np.stack((-along[:, 1], along[:, 0]), axis=1) * (0.5 * width_m + side_m)
    tip, tail = front + along * BODY_MARGIN_M, front - along * (length_m + BODY_MARGIN_M)
    return np.stack((tip + across, tip - across, tail - across, tail + across), axis=1)


@dataclass(frozen=True)
class Sweep:
    """One body carried over the conflict zone: from before the stop line to its rear well down the exit lane."""

    track: Track
    length_m: float
    """Stop line to exit lane."""
    footprint: Footprint
    lane_width_m: float

    @cached_property
    def fronts_m(self) -> Floats:
        """The sampled front positions past the stop line."""
        end = self.length_m + self.footprint.length_m + DOWNSTREAM_M
        return np.arange(-UPSTREAM_M, end + SAMPLE_STEP_M, SAMPLE_STEP_M)

    @cached_property
    def polygons(self) -> npt.NDArray[np.object_]:
        """The body at each sampled position."""
        side = min(BODY_MARGIN_M, 0.5 * (self.lane_width_m - self.footprint.width_m) - LANE_SLACK_M)
        corners = bodies(self.track, self.fronts_m, self.footprint.length_m, self.footprint.width_m, max(0.0, side))
        return np.asarray(shapely.polygons(corners), dtype=np.object_)

    @cached_property
    def region(self) -> shapely.Geometry:
        """All the ground the body covers on its way."""
        ground = shapely.union_all(self.polygons)
        shapely.prepare(ground)
        return ground

    def window(self, region: shapely.Geometry) -> Window | None:
        """Front at first touch of `region` and rear at last, m past the stop line; None without one."""
        touched = np.flatnonzero(shapely.intersects(region, self.polygons))
        if touched.size == 0:
            return None
        first = float(self.fronts_m[touched[0]]) - SAMPLE_STEP_M
        last = float(self.fronts_m[touched[-1]]) + SAMPLE_STEP_M
        return round(first, 6), round(last - self.footprint.length_m, 6)
