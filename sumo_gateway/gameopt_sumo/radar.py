"""Who is ahead of whom: the nearest vehicle ahead on each vehicle's path, across diverges and merges."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from gameopt_wire.intersection import IntersectionMap

APART_M = 2.8
"""Where centre lines out of one lane are this far apart, bodies no longer follow each other."""
LET_IN_M = 1.0
"""Who wants in seems this much longer: SUMO's driver changes lanes only where it finds its own minimum gap."""
_STEP_M = 0.25


@dataclass(frozen=True, slots=True)
class Body:
    """A vehicle on the lanes of the junction.

    `past_line_m` is its front bumper along its path, negative before the stop line. On an exit lane `on_exit`
    is that lane and `exit_m` the position on it. `lane` is the index of the approach lane it is on, came from
    or is bound for. `shared` are the upstream lanes it stands on, with its front's position along each, beyond its
    end too, and how far each reaches. A vehicle that has to change lanes `wants` approach lanes: whoever comes up
    behind it there lets it in. Its image on such a lane is `beside`. One that `halts` has planned a stop before the
    line.
    """

    vehicle: str
    movement: int | None
    lane: int | None
    past_line_m: float
    length_m: float
    on_exit: str | None = None
    exit_m: float = 0.0
    shared: tuple[tuple[str, float, float], ...] = ()
    wants: tuple[tuple[int, float], ...] = ()
    beside: bool = False
    halts: bool = False


class Radar:
    """Finds leaders among all bodies of one step."""

    def __init__(self, intersection_map: IntersectionMap) -> None:
        self._movements = intersection_map.movements
        self._apart_m = _apart(intersection_map)

    def leaders(self, bodies: Iterable[Body]) -> dict[str, tuple[str, float]]:
        """For every vehicle with one ahead: the leader and the gap, bumper to bumper, m."""
        out_of_lane: dict[int, list[Body]] = defaultdict(list)
        on_exit: dict[str, list[Body]] = defaultdict(list)
        upstream: dict[str, list[tuple[float, float, Body]]] = defaultdict(list)
        for body in bodies:
            if body.on_exit is not None:
                on_exit[body.on_exit].append(body)
            if body.lane is not None and not self._gone(body):
                out_of_lane[body.lane].append(body)
            for lane, past_line_m in body.wants:
                out_of_lane[lane].append(replace(body, lane=lane, past_line_m=past_line_m, beside=True))
            for lane_id, position_m, reach_m in body.shared:
                upstream[lane_id].append((position_m, reach_m, body))
        found: dict[str, tuple[str, float]] = {}
        for queue in on_exit.values():
            queue.sort(key=lambda body: body.exit_m)
            for body, ahead in pairwise(queue):
                found[body.vehicle] = (ahead.vehicle, ahead.exit_m - ahead.length_m - body.exit_m)
        for queue in out_of_lane.values():
            queue.sort(key=lambda body: body.past_line_m)
            for index, body in enumerate(queue):
                if body.on_exit is None and not body.beside:
                    leader = self._nearest(body, queue[index + 1 :], on_exit)
                    if leader is not None:
                        found[body.vehicle] = leader
        for way in upstream.values():
            way.sort(key=lambda entry: entry[0])
            for (position_m, reach_m, body), (ahead_m, _, ahead) in pairwise(way):
                gap_m = ahead_m - ahead.length_m - position_m
                nearer = body.vehicle not in found or gap_m < found[body.vehicle][1]
                if position_m <= reach_m and nearer:  # else its front has left the lane, to go its own way
                    found[body.vehicle] = (ahead.vehicle, gap_m)
        return found

    def _gone(self, body: Body) -> bool:
        """Wholly on the exit lane."""
        return (
            body.on_exit is not None
            and body.movement is not None
            and body.past_line_m - body.length_m >= self._movements[body.movement].length_m
        )

    def _nearest(self, body: Body, ahead: list[Body], on_exit: dict[str, list[Body]]) -> tuple[str, float] | None:
        nearest: tuple[str, float] | None = None
        candidates: list[tuple[str, float]] = []
        for other in ahead:
            rear_m = other.past_line_m - other.length_m
            if other.beside:
                if rear_m >= body.past_line_m:
                    candidates.append((other.vehicle, rear_m - body.past_line_m - LET_IN_M))
                continue
            same = other.past_line_m <= 0.0 or other.movement == body.movement
            if same or rear_m < self._apart_m.get((body.movement, other.movement), 0.0):
                candidates.append((other.vehicle, rear_m - body.past_line_m))
            if same:
                break
        if body.movement is not None:
            movement = self._movements[body.movement]
            last = next(iter(on_exit.get(movement.exit_lane, ())), None)
            if last is not None:
                rear_m = movement.length_m + last.exit_m - last.length_m
                candidates.append((last.vehicle, rear_m - body.past_line_m))
        for candidate in candidates:
            if nearest is None or candidate[1] < nearest[1]:
                nearest = candidate
        return nearest


def _apart(intersection_map: IntersectionMap) -> dict[tuple[int | None, int | None], float]:
    """For movements i, j out of one lane: how far along j bodies on i and j stand clear, m."""
    result: dict[tuple[int | None, int | None], float] = {}
    lines = [shapely.LineString(movement.path) for movement in intersection_map.movements]
    for i, first in enumerate(intersection_map.movements):
        for j, second in enumerate(intersection_map.movements):
            if i != j and first.lane == second.lane:
                along = np.arange(0.0, lines[j].length, _STEP_M)
                distance = shapely.distance(lines[i], shapely.line_interpolate_point(lines[j], along))
                apart = np.flatnonzero(distance >= APART_M)
                result[i, j] = float(along[apart[0]]) if apart.size else second.length_m
    return result
