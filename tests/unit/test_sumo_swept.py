"""The conflict areas of junctions of any shape, against bodies that shapely carries along the net's own lanes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from plain_nets import NAMES, build_plain
from shapely.geometry import LineString
from shapely.ops import unary_union
from swept import body

from gameopt_sumo.junction import read_net
from gameopt_sumo.network import read_map
from gameopt_wire.intersection import ConflictArea, Footprint, IntersectionMap

STEP_M = 0.1
UPSTREAM_M, DOWNSTREAM_M = 20.0, 20.0
EVERY = 5
"""One conflict area in so many is looked at."""
SHORT_M = 0.15
"""Where corners graze, the slivers between two of the map's samples (25 cm) may delay the first touch this much."""


def whole_line(net: Any, found: IntersectionMap, index: int) -> tuple[LineString, float]:
    """Approach lane, path and exit lane as the net draws them, and how far along the stop line is."""
    movement = found.movements[index]
    before = net.getLane(found.lanes[movement.lane].id).getShape()
    after = net.getLane(movement.exit_lane).getShape()
    return LineString([*before, *movement.path, *after]), LineString(before).length


def in_its_lane(size: Footprint) -> Footprint:
    """A body grown by 0.3 m that does not touch those in the lanes beside it, 3.2 m wide."""
    return msgspec.structs.replace(size, width_m=min(size.width_m, 3.2 - 0.62))


def check(net: Any, found: IntersectionMap, area: ConflictArea, f: int, g: int) -> None:
    """The window of `a` is never short by more than `SHORT_M`, nor longer than 0.6 m."""
    window = area.a_windows_m[f][g]
    assert window is not None
    size, other_size = (in_its_lane(found.footprints[k]) for k in (f, g))
    (line, at_m), (other_line, other_at_m) = (whole_line(net, found, index) for index in (area.a, area.b))
    reach = UPSTREAM_M + other_size.length_m + found.movements[area.b].length_m + DOWNSTREAM_M
    fronts = [other_at_m - UPSTREAM_M + STEP_M * k for k in range(int(reach / STEP_M))]
    ground = unary_union([body(other_line, x, other_size.length_m, other_size.width_m) for x in fronts])
    near = [window[0] + STEP_M * k for k in range(-10, 11)]
    near += [window[1] + size.length_m + STEP_M * k for k in range(-10, 11)]
    swept_to_m = found.movements[area.a].length_m + size.length_m + DOWNSTREAM_M
    touched = [
        x for x in near if x <= swept_to_m and body(line, at_m + x, size.length_m, size.width_m).intersects(ground)
    ]
    assert touched[0] - 0.6 - STEP_M <= window[0] <= touched[0] + SHORT_M
    rear_m = touched[-1] - size.length_m
    assert rear_m - SHORT_M <= window[1] <= rear_m + 0.6 + STEP_M


def drawn_to_scale(found: IntersectionMap, area: ConflictArea) -> bool:
    """Whether SUMO counts both paths as long as it draws them; lanes side by side share one length."""
    paths = (found.movements[index] for index in (area.a, area.b))
    return all(abs(LineString(each.path).length - each.length_m) < 0.02 for each in paths)


@pytest.mark.parametrize(
    ("name", "pairs"),
    [*((name, ((0, 0), (2, 2))) for name in NAMES), *((name, ((4, 0), (0, 4), (4, 4))) for name in NAMES[1:3])],
)
def test_windows_cover_the_swept_ground(tmp_path: Path, name: str, pairs: tuple[tuple[int, int], ...]) -> None:
    """Of cars and trucks, and of the 18.75 m that a map may be asked to hold for."""
    net_file = build_plain(name, tmp_path)
    net, found = read_net(net_file), read_map(net_file, articulated=True)
    crossing = [area for area in found.areas if not area.merge and not area.beside]
    looked_at = 0
    for area in [area for area in crossing if drawn_to_scale(found, area)][::EVERY]:
        for f, g in pairs:
            if area.a_windows_m[f][g] is not None and area.a_windows_m[f][g][0] > -UPSTREAM_M + 1.0:
                check(net, found, area, f, g)
                looked_at += 1
    assert looked_at >= 1


@pytest.mark.parametrize("name", NAMES)
def test_long_bodies_change_nothing_among_the_others_but_where_they_wait(tmp_path: Path, name: str) -> None:
    net_file = build_plain(name, tmp_path)
    usual, longer = read_map(net_file), read_map(net_file, articulated=True)
    assert longer.footprints[:-1] == usual.footprints
    assert not usual.covers(18.75, 2.6)
    assert longer.covers(18.75, 2.6)
    sizes = len(usual.footprints)
    among = {(area.a, area.b): [row[:sizes] for row in area.a_windows_m[:sizes]] for area in longer.areas}
    assert all(among[area.a, area.b] == area.a_windows_m for area in usual.areas)
    for before, after in zip(usual.movements, longer.movements, strict=True):
        assert all(b <= a < UPSTREAM_M - 1.0 for b, a in zip(before.setback_m, after.setback_m[:sizes], strict=True))
