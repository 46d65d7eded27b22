"""Conflict areas: for every two movements, where along each the bodies of both sweep the same ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import shapely

from gameopt_sumo.geometry import BODY_MARGIN_M, Sweep, Track, Window
from gameopt_wire.intersection import ConflictArea, Footprint

Windows = list[list[Window | None]]

FOOTPRINTS = (
    Footprint(name="passenger", length_m=5.0, width_m=1.8),
    Footprint(name="emergency", length_m=6.5, width_m=2.2),
    Footprint(name="truck", length_m=10.0, width_m=2.5),
    Footprint(name="bus", length_m=12.0, width_m=2.55),
)
"""Body sizes the areas are swept with."""
ARTICULATED = Footprint(name="articulated", length_m=18.75, width_m=2.6)
"""The longest trucks and buses, swept too where that is asked for: their tails reach so far over the lanes beside them
that everybody waits further upstream. SUMO poses them as rigid bodies, so they are swept as that."""


@dataclass(frozen=True)
class SweptMovement:
    """What a movement's conflicts depend on; one `Sweep` per footprint is built and kept."""

    lane: str
    approach: str
    exit_lane: str
    length_m: float
    track: Track
    lane_width_m: float
    sweeps: list[Sweep] = field(default_factory=list)

    def swept(self, footprints: Sequence[Footprint]) -> list[Sweep]:
        """One sweep per footprint."""
        if not self.sweeps:
            self.sweeps.extend(Sweep(self.track, self.length_m, f, self.lane_width_m) for f in footprints)
        return self.sweeps


def conflict_areas(
    movements: Sequence[SweptMovement], footprints: Sequence[Footprint] = FOOTPRINTS
) -> list[ConflictArea]:
    """All conflict areas among `movements`, by their indices.

    Movements out of the same lane have none: they keep the order they have in that lane.
    """
    areas = []
    for (i, a), (j, b) in combinations(enumerate(movements), 2):
        if a.lane != b.lane and (area := _area(i, a, j, b, footprints)) is not None:
            areas.append(area)
    return areas


def _area(i: int, a: SweptMovement, j: int, b: SweptMovement, footprints: Sequence[Footprint]) -> ConflictArea | None:
    merge = a.exit_lane == b.exit_lane
    of_a, of_b = a.swept(footprints), b.swept(footprints)
    if not merge and not any(shapely.intersects(f.region, g.region) for f in of_a for g in of_b):
        return None
    a_windows: Windows = [[_window(f, g.region, merge) for g in of_b] for f in of_a]
    b_windows: Windows = [[_window(g, f.region, merge) for f in of_a] for g in of_b]
    _drop_one_sided(a_windows, b_windows)
    if not any(window for row in a_windows for window in row):
        return None
    # Where even the smallest bodies touch, the paths cross; else it is a long body's tail that swings out.
    beside = a.approach == b.approach and not merge and a_windows[0][0] is None
    return ConflictArea(a=i, b=j, merge=merge, beside=beside, a_windows_m=a_windows, b_windows_m=b_windows)


def _window(sweep: Sweep, region: shapely.Geometry, merge: bool) -> Window | None:
    """The window on `sweep`; where both leave by one exit lane it ends once the rear stands on that lane.

    From there on the two are leader and follower.
    """
    window = sweep.window(region)
    if window is None or not merge:
        return window
    return window[0], round(min(window[1], sweep.length_m + BODY_MARGIN_M), 6)


def _drop_one_sided(a_windows: Windows, b_windows: Windows) -> None:
    """A touch that only one side's samples see is a grazing corner: both sides drop it, or neither has it."""
    for f, row in enumerate(a_windows):
        for g in range(len(row)):
            if row[g] is None or b_windows[g][f] is None:
                a_windows[f][g] = b_windows[g][f] = None
