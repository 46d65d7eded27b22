"""A map and the net's lanes it was read from: where each lies along the path of whoever is on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from gameopt_sumo.junction import Link
from gameopt_sumo.upstream import Way, entry_speed_mps, yields_at_end
from gameopt_wire.intersection import IntersectionMap


@dataclass(frozen=True)
class Place:
    """A lane of the junction, or of the way to it: where it lies along the path of whoever is on it.

    A front bumper at p on an approach or internal lane is `offset_m` + p past the stop line. `lane` is the
    index of the approach lane in the map, `movement` of the only movement over an internal lane. An approach
    lane is observed from `observed_from_m` on. An upstream lane may lead to several approach lanes: `offsets_m`
    has its offset for each; `limit_mps` is its speed limit. Of an exit lane `yields_m` is its length, if it ends at
    a junction where vehicles have to yield.
    """

    kind: Literal["approach", "internal", "exit", "upstream"]
    offset_m: float = 0.0
    lane: int | None = None
    movement: int | None = None
    observed_from_m: float = 0.0
    offsets_m: Mapping[int, float] = field(default_factory=dict)
    limit_mps: float | None = None
    yields_m: float | None = None


@dataclass(frozen=True)
class Choice:
    """A movement that an approach lane offers, by the edge it leads to and its first internal lane."""

    movement: int
    exit_edge: str
    via: str


@dataclass(frozen=True)
class Shared:
    """An upstream lane, for one approach lane: a vehicle stands on it from `begin_m` until its rear is past `end_m`."""

    lane: str
    begin_m: float
    end_m: float


@dataclass(frozen=True)
class Layout:
    """A map together with the net's lanes it was read from."""

    map: IntersectionMap
    places: dict[str, Place]
    """Every lane of the approach edges, the junction, the exit edges and the ways upstream."""
    choices: dict[str, list[Choice]]
    """By approach lane."""
    shared: list[tuple[Shared, ...]]
    """The upstream lanes of each approach lane of the map."""
    gates_mps: dict[str, float]
    """Internal lanes of other junctions by which vehicles come into a short zone, and how fast they may."""


def layout_of(
    net: Any, intersection_map: IntersectionMap, links: list[Link], lanes: list[Any], ways: list[Way]
) -> Layout:
    """The layout of a map whose movements, in order, are `links`, and whose lanes are `lanes` with their `ways`."""
    return Layout(
        map=intersection_map,
        places=_places(net, intersection_map, links, lanes, ways),
        choices=_choices(links),
        shared=[
            tuple(Shared(section.lane.getID(), section.begin_m, section.end_m) for section in way.sections[1:])
            for way in ways
        ],
        gates_mps=_gates(intersection_map, ways),
    )


def gap_before(layout: Layout, lane: str) -> float | None:
    """How far it is from where a lane begins to the control zone that it leads into, m; None where it leads into none.

    Negative where the lane begins within the zone.
    """
    place = layout.places.get(lane)
    if place is None or place.kind not in ("approach", "upstream"):
        return None
    if place.kind == "approach":
        return None if place.lane is None else -place.offset_m - layout.map.lanes[place.lane].zone_m
    return min(-layout.map.lanes[index].zone_m - offset_m for index, offset_m in place.offsets_m.items())


def _places(
    net: Any, intersection_map: IntersectionMap, links: list[Link], lanes: list[Any], ways: list[Way]
) -> dict[str, Place]:
    """Approach lanes first, then inside, exits, upstream: a lane that is both entry and exit counts as entry."""
    index = {lane.getID(): i for i, lane in enumerate(lanes)}
    places: dict[str, Place] = {}
    for link in links:
        for lane in link.lane.getEdge().getLanes():
            length_m = lane.getLength()
            zone_m = min(intersection_map.control_zone_m, length_m)
            places[lane.getID()] = Place("approach", -length_m, index.get(lane.getID()), None, length_m - zone_m)
    for movement, link in enumerate(links):
        offset_m = 0.0
        for lane in link.internal:
            places[lane.getID()] = Place("internal", offset_m, index[link.lane.getID()], movement)
            offset_m += lane.getLength()
    for edge in dict.fromkeys(link.exit_lane.getEdge() for link in links):
        yields = yields_at_end(net, edge)
        for lane in edge.getLanes():
            places.setdefault(lane.getID(), Place("exit", yields_m=lane.getLength() if yields else None))
    for lane_id, place in _upstream(ways).items():
        places.setdefault(lane_id, place)
    return places


def _upstream(ways: list[Way]) -> dict[str, Place]:
    offsets: dict[str, dict[int, float]] = {}
    limits: dict[str, float] = {}
    for index, way in enumerate(ways):
        for section in way.sections[1:]:
            for lane, begin_m in ((section.lane, section.begin_m), *section.inside):
                offsets.setdefault(lane.getID(), {})[index] = begin_m
                limits[lane.getID()] = lane.getSpeed()
    return {lane: Place("upstream", offsets_m=found, limit_mps=limits[lane]) for lane, found in offsets.items()}


def _choices(links: list[Link]) -> dict[str, list[Choice]]:
    choices: dict[str, list[Choice]] = {}
    for movement, link in enumerate(links):
        choice = Choice(movement, link.exit_lane.getEdge().getID(), link.internal[0].getID())
        choices.setdefault(link.lane.getID(), []).append(choice)
    return choices


def _gates(intersection_map: IntersectionMap, ways: list[Way]) -> dict[str, float]:
    """The longest vehicle waits the furthest upstream, so its setback is what counts."""
    gates: dict[str, float] = {}
    for index, way in enumerate(ways):
        setbacks = [max([0.0, *m.setback_m]) for m in intersection_map.movements if m.lane == index]
        speed_mps = entry_speed_mps(way.zone_m, max(setbacks, default=0.0))
        for gate in way.gates:
            gates[gate] = min(gates.get(gate, speed_mps), speed_mps)
    return gates
