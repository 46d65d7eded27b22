"""Where the paths of two movements out of one lane part: from there on one vehicle no longer leads the other."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_wire.intersection import IntersectionMap, Movement
from gameopt_wire.motion import REAR_GAP_M

APART_M = 2.8
"""Where centre lines out of one lane are this far apart, bodies no longer follow each other."""
STEP_M = 0.25


def apart(intersection: IntersectionMap) -> Floats:
    """(M, M): how far past the line the rear of a vehicle on the second movement stands clear of the first, m.

    Infinite for a movement and itself, and for movements out of different lanes.
    """
    movements = intersection.movements
    out = np.full((len(movements), len(movements)), np.inf)
    for i, first in enumerate(movements):
        for j, second in enumerate(movements):
            if i == j or first.lane != second.lane:
                continue
            out[i, j] = second.length_m
            if min(len(first.path), len(second.path)) > 1:
                along, points = _sampled(np.array(second.path), second.length_m)
                clear = np.flatnonzero(_distances(points, np.array(first.path)) >= APART_M)
                out[i, j] = along[clear[0]] if len(clear) else second.length_m
    return out


@kernel
def spans(length: Floats, path_m: Floats, turns_back: Bools, tail_m: Floats) -> Floats:
    """(n,): how long a vehicle is to those behind it in its lane, m.

    One that turns back stands beside its own lane with all of its body that its path over the junction does not hold:
    in a narrow turn it sweeps that much of the lane it came from. Any other is longer by its tail (`tails`).
    """
    return length + np.where(turns_back, np.maximum(0.0, length - path_m), tail_m)


def tails(intersection: IntersectionMap) -> Floats:
    """(M, F): how far a body's tail reaches back from where its rear is on the path, m; 0 within the standing gap.

    A body is longer than the chord between its bumpers' places on a bend, and all that it is longer lies behind.
    """
    out = np.zeros((len(intersection.movements), len(intersection.footprints)))
    for m, movement in enumerate(intersection.movements):
        for f, footprint in enumerate(intersection.footprints):
            if len(movement.path) > 1:
                reach = footprint.length_m - _shortest_chord(movement, footprint.length_m)
                out[m, f] = reach if reach > REAR_GAP_M else 0.0
    return out


def _shortest_chord(movement: Movement, length_m: float) -> float:
    """Between two places on a path that are `length_m` apart along it, m; it goes straight on at both ends."""
    first, last = np.array(movement.path[:2]), np.array(movement.path[-2:])
    ends = [length_m * (a - b) / np.hypot(*(a - b)) for a, b in (first, last[::-1])]
    path = np.vstack((first[0] + ends[0], movement.path, last[1] + ends[1]))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    rears = np.arange(0.0, along[-1] - length_m, STEP_M)
    points = [np.stack([np.interp(at, along, path[:, axis]) for axis in (0, 1)]) for at in (rears, rears + length_m)]
    return float(np.hypot(*(points[1] - points[0])).min(initial=length_m))


def ranks(intersection: IntersectionMap) -> Ints:
    """(M,): the how manieth movement of its lane each is."""
    lanes = [movement.lane for movement in intersection.movements]
    return np.array([lanes[:index].count(lane) for index, lane in enumerate(lanes)], dtype=np.int64)


def _sampled(path: Floats, length_m: float) -> tuple[Floats, Floats]:
    """Distances along a path, `length_m` as the map counts it, and the points there."""
    ends = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    along = np.arange(0.0, length_m, STEP_M)
    drawn = along * (ends[-1] / length_m)
    return along, np.stack([np.interp(drawn, ends, path[:, axis]) for axis in (0, 1)], axis=1)


def _distances(points: Floats, path: Floats) -> Floats:
    """(n,): how far each point is from a path."""
    start, way = path[:-1], np.diff(path, axis=0)
    share = np.einsum("nkd,kd->nk", points[:, None] - start, way) / np.maximum(np.sum(way**2, axis=1), 1e-12)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * way
    return np.asarray(np.min(np.hypot(*np.moveaxis(points[:, None] - nearest, -1, 0)), axis=1))
