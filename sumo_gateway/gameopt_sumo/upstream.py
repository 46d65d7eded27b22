"""How far back the control zone reaches: from an approach lane over the edges before it, as long as nothing conflicts.

Upstream of the approach there may be junctions where lanes only split, or where the net merely changes: nobody has to
yield there, so vehicles can be controlled on their way over them. The zone ends at the first junction where movements
cross or merge, or that has lights or pedestrian crossings of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import shapely

from gameopt_sumo.junction import Link, links_over
from gameopt_sumo.refusal import foreign_paths, pedestrian_crossings
from gameopt_wire import motion

SLOWEST_MPS = 1.0
"""Vehicles may always come into a zone at this speed, however short it is."""


@dataclass(frozen=True)
class Section:
    """A lane of the way, from where it begins to where the next one does; m past the stop line, negative."""

    lane: Any
    begin_m: float
    end_m: float
    inside: tuple[tuple[Any, float], ...] = ()
    """The lanes within the junction after it, each with where it begins."""


@dataclass(frozen=True)
class Way:
    """What lies upstream of one stop line: the approach lane first, then lane by lane back to where the zone ends."""

    sections: tuple[Section, ...]
    zone_m: float
    gates: tuple[str, ...]
    """The lanes of the junction before it by which vehicles come into the zone; empty where none is known."""


def way_upstream(net: Any, node: Any, lane: Any, control_zone_m: float) -> Way:
    """The way back from `lane`, an approach lane of `node`, for `control_zone_m` or as far as nothing conflicts."""
    reach_m = lane.getLength()
    sections = [Section(lane, -reach_m, 0.0)]
    while reach_m < control_zone_m and (link := _only_feeder(net, node, lane)) is not None:
        end_m = -reach_m
        inside = []
        for inner in reversed(link.internal):
            reach_m += inner.getLength()
            inside.append((inner, -reach_m))
        lane = link.lane
        reach_m += lane.getLength()
        sections.append(Section(lane, -reach_m, end_m, tuple(inside)))
    gates = {
        link.internal[-1].getID() for link in links_over(net, lane.getEdge().getFromNode()) if link.exit_lane is lane
    }
    short = reach_m < control_zone_m
    return Way(tuple(sections), min(control_zone_m, reach_m), tuple(sorted(gates)) if short else ())


def _only_feeder(net: Any, managed: Any, lane: Any) -> Link | None:
    """The link by which vehicles come onto `lane`, where its junction is free of conflicts."""
    before = lane.getEdge().getFromNode()
    links = links_over(net, before)
    feeders = [link for link in links if link.exit_lane is lane]
    if before is managed or len(feeders) != 1 or feeders[0].lane.getEdge().getFromNode() is managed:
        return None
    return feeders[0] if _free(net, before, links) else None


def yields_at_end(net: Any, edge: Any) -> bool:
    """Whether vehicles that go on beyond an edge have to mind somebody at the junction there."""
    beyond = edge.getToNode()
    links = links_over(net, beyond)
    return bool(links) and not _free(net, beyond, links)


def _free(net: Any, node: Any, links: list[Link]) -> bool:
    """Whether nobody has to yield on a junction: no lights, no crossings, no two ways that cross or merge."""
    if node.getType().startswith(("traffic_light", "rail")) or any(_others(net, node)):
        return False
    lines = [(link, shapely.LineString(link.shape)) for link in links]
    return not any(
        a.lane is not b.lane and (a.exit_lane is b.exit_lane or line.intersects(other))
        for (a, line), (b, other) in combinations(lines, 2)
    )


def _others(net: Any, node: Any) -> Iterator[object]:
    yield from pedestrian_crossings(net, node)
    yield from foreign_paths(net, node)


def entry_speed_mps(zone_m: float, setback_m: float) -> float:
    """The speed at which a vehicle can come into a zone and stop gently before the line."""
    room_m = zone_m - setback_m - motion.STOP_OFFSET_M
    return max(SLOWEST_MPS, math.sqrt(2.0 * motion.TURN_DECEL_MPS2 * max(0.0, room_m)))
