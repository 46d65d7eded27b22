"""Who may not be in the conflict zone with whom: the paper's table, and the ground of an intersection map."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from gameopt_im.core.diverging import apart, ranks, tails
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_wire.intersection import ConflictArea, IntersectionMap
from gameopt_wire.messages import Geometry

PAPER_GROUPS: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "0-1": frozenset({"0-2", "1-1", "2-2"}),
        "0-2": frozenset({"0-1", "1-2", "3-1"}),
        "1-1": frozenset({"0-1", "1-2", "3-2"}),
        "1-2": frozenset({"0-2", "1-1", "2-1"}),
        "2-1": frozenset({"1-2", "2-2", "3-1"}),
        "2-2": frozenset({"0-1", "2-1", "3-2"}),
        "3-1": frozenset({"0-2", "2-1", "3-2"}),
        "3-2": frozenset({"1-1", "2-2", "3-1"}),
    }
)
"""`table: grouping`: for each lane group x-y (road, intention) the groups it does not conflict with.

Right turns (x-0) stand outside the table: they conflict with nobody.
"""

OUTSIDE = -1
"""The conflict group of a vehicle that conflicts with nobody: it takes no part in any auction."""


def no_conflict_groups(intersection: IntersectionMap) -> dict[str, frozenset[str]]:
    """The same table for a map: per group that conflicts with somebody, the groups it never conflicts with.

    Equal to `PAPER_GROUPS` for a four-arm intersection numbered as in the paper.
    """
    names = {movement.group for movement in intersection.movements}
    foes: dict[str, set[str]] = {name: set() for name in names}
    for area in intersection.areas:
        if area.beside:
            continue
        a, b = intersection.movements[area.a].group, intersection.movements[area.b].group
        foes[a].add(b)
        foes[b].add(a)
    contested = {name for name in names if foes[name]}
    return {name: frozenset(contested - foes[name] - {name}) for name in sorted(contested)}


@dataclass(frozen=True, slots=True)
class Ground:
    """M movements over F footprints as arrays, made once from a map; m and m/s, distances past the stop line.

    `conflict` (M, M) is symmetric with a False diagonal. `windows` (M, F, M, F, 2) holds (entry of the front,
    exit of the rear) on the first movement against a body on the second, NaN where the two never touch.
    `clear` is where the rear stands clear of everything, `setback` (M, F) how far before the line
    an uncleared vehicle keeps off the ground. `turn_mps` is inf where no turning speed holds.
    `free` marks movements that conflict with nobody.
    `apart` (M, M) is where the rear on the second of two movements out of one lane stands clear of the first (inf for
    any other two), `rank` the how manieth of its lane a movement is.
    `turns_back` marks U-turns. `tail` (M, F) is how far a body's tail reaches back over its own lane.
    """

    conflict: Bools
    windows: Floats
    lane: Ints
    exit_lane: Ints
    length: Floats
    clear: Floats
    setback: Floats
    turn_mps: Floats
    exit_mps: Floats
    exit_length: Floats
    limit_mps: Floats
    footprint_length: Floats
    footprint_width: Floats
    free: Bools
    apart: Floats
    rank: Ints
    turns_back: Bools
    tail: Floats


def ground(intersection: IntersectionMap, geometry: Geometry, lateral_margin_m: float, turn_speed: bool) -> Ground:
    """The arrays of a map under one geometry.

    `areas` takes the windows of the swept bodies. `box` is the paper's: in every conflicting pair each
    keeps the whole zone, from the stop line to max(M_sl, the movement's last area), with M_sl =
    `lateral_margin_m`.
    Vehicles of one lane follow each other, so areas between movements of one lane are left out.
    Raises ValueError where the map points at a movement, lane or footprint it does not have.
    """
    movements, lanes, footprints = intersection.movements, intersection.lanes, intersection.footprints
    for movement in movements:
        if movement.lane >= len(lanes):
            raise ValueError(f"movement {movement.id!r}: lane {movement.lane} of {len(lanes)}")
    count, sizes = len(movements), len(footprints)
    conflict = np.zeros((count, count), dtype=np.bool_)
    windows = np.full((count, sizes, count, sizes, 2), np.nan)
    for area in intersection.areas:
        _check_area(area, count, sizes)
        a, b = area.a, area.b
        if movements[a].lane == movements[b].lane:
            continue
        conflict[a, b] = conflict[b, a] = not area.beside
        for f, g in itertools.product(range(sizes), repeat=2):
            windows[a, f, b, g] = _window(area.a_windows_m[f][g])
            windows[b, g, a, f] = _window(area.b_windows_m[g][f])
    clear = np.array([movement.clear_m for movement in movements])
    if geometry == "box":
        windows = _box(windows, conflict, lateral_margin_m)
        clear = np.maximum(clear, lateral_margin_m)
    exits = list(dict.fromkeys(movement.exit_lane for movement in movements))
    turns = [movement.turn_speed_mps if turn_speed else None for movement in movements]
    return Ground(
        conflict=conflict,
        windows=windows,
        lane=np.array([movement.lane for movement in movements], dtype=np.int64),
        exit_lane=np.array([exits.index(movement.exit_lane) for movement in movements], dtype=np.int64),
        length=np.array([movement.length_m for movement in movements]),
        clear=clear,
        setback=np.array([movement.setback_m or [0.0] * sizes for movement in movements]),
        turn_mps=np.array([np.inf if turn is None else turn for turn in turns]),
        exit_mps=np.array([movement.exit_speed_mps for movement in movements]),
        exit_length=np.array([movement.exit_length_m for movement in movements]),
        limit_mps=np.array([lanes[movement.lane].speed_limit_mps for movement in movements]),
        footprint_length=np.array([footprint.length_m for footprint in footprints]),
        footprint_width=np.array([footprint.width_m for footprint in footprints]),
        free=np.logical_not(conflict.any(axis=1)),
        apart=apart(intersection),
        rank=ranks(intersection),
        turns_back=np.array([movement.intention == "turnaround" for movement in movements], dtype=np.bool_),
        tail=tails(intersection),
    )


def _check_area(area: ConflictArea, count: int, sizes: int) -> None:
    if not 0 <= area.a < area.b < count:
        raise ValueError(f"conflict area {area.a}-{area.b}: wants a < b < {count}")
    for table in (area.a_windows_m, area.b_windows_m):
        if len(table) != sizes or any(len(row) != sizes for row in table):
            raise ValueError(f"conflict area {area.a}-{area.b}: wants {sizes} x {sizes} windows")


def _window(window: tuple[float, float] | None) -> tuple[float, float]:
    return (np.nan, np.nan) if window is None else window


def _box(windows: Floats, conflict: Bools, lateral_margin_m: float) -> Floats:
    """(M, F, M, F, 2): entry 0 and exit max(M_sl, the last area's exit of that movement and footprint)."""
    count, sizes = windows.shape[:2]
    exits = windows[..., 1].reshape(count, sizes, count * sizes)
    last = np.fmax.reduce(exits, axis=2, initial=lateral_margin_m)
    box = windows.copy()  # a tail over the lane beside it keeps its own window
    pairs = np.broadcast_to(conflict[:, None, :, None], box.shape[:-1])
    box[..., 0][pairs] = 0.0
    box[..., 1][pairs] = np.broadcast_to(last[:, :, None, None], pairs.shape)[pairs]
    return box


@kernel
def groups(movements: Ints, conflict: Bools) -> Ints:
    """(n,) conflict group of each vehicle present: connected components of the conflict graph.

    Vehicles of one movement share a component; a movement that conflicts with none anywhere is `OUTSIDE`.
    Components are numbered by their lowest movement, so the labels do not depend on the vehicles' order.
    """
    count = len(conflict)
    present, label = np.zeros(count, np.bool_), np.full(count, OUTSIDE)
    for movement in movements:
        present[movement] = True
    reached, component = np.empty(count, np.int64), 0
    for first in range(count):
        if not present[first] or label[first] != OUTSIDE or not conflict[first].any():
            continue
        reached[0], size, done = first, 1, 0
        label[first] = component
        while done < size:
            for other in range(count):
                if conflict[reached[done], other] and present[other] and label[other] == OUTSIDE:
                    label[other] = component
                    reached[size] = other
                    size += 1
            done += 1
        component += 1
    return label[movements]
