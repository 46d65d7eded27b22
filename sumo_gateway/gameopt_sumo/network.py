"""A SUMO net (.net.xml) read into an intersection map. Needs sumolib and shapely, not libsumo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from gameopt_sumo.areas import ARTICULATED, FOOTPRINTS, SweptMovement, conflict_areas
from gameopt_sumo.geometry import Window
from gameopt_sumo.junction import (
    MANAGED_CLASSES,
    Link,
    NetworkError,
    choose,
    links_over,
    number_roads,
    read_net,
)
from gameopt_sumo.layout import Layout, layout_of
from gameopt_sumo.refusal import refuse_foreign_paths, refuse_short_exits
from gameopt_sumo.upstream import way_upstream
from gameopt_wire.intersection import INTENTION_NUMBER, ConflictArea, IntersectionMap, Lane, Movement

DEFAULT_CONTROL_ZONE_M = 150.0
_LIMIT_TOLERANCE_MPS = 0.05

__all__ = [
    "Layout",
    "NetworkError",
    "map_json",
    "packaged_map",
    "read_layout",
    "read_map",
    "without_turn_speeds",
]


def read_map(
    net_file: Path | str,
    junction: str | None = None,
    control_zone_m: float = DEFAULT_CONTROL_ZONE_M,
    *,
    articulated: bool = False,
) -> IntersectionMap:
    """The map of one junction of a SUMO net; its name is the junction's id.

    Without `junction` the net must have exactly one with crossing movements. `control_zone_m` is cut to where
    another junction with conflicts lies nearer. With `articulated` it also holds for bodies of up to 18.75 m.
    Raises `NetworkError`.
    """
    return read_layout(net_file, junction, control_zone_m, articulated=articulated).map


def read_layout(
    net_file: Path | str,
    junction: str | None = None,
    control_zone_m: float = DEFAULT_CONTROL_ZONE_M,
    *,
    articulated: bool = False,
) -> Layout:
    """As `read_map`, with the lanes behind the map. Raises `NetworkError`."""
    net = read_net(Path(net_file))
    chosen = choose(net, Path(net_file), junction)
    links = links_over(net, chosen)
    if not links:
        classes = ", ".join(MANAGED_CLASSES)
        raise NetworkError(f"{net_file}: junction {chosen.getID()!r} has no movement for {classes}")
    refuse_foreign_paths(net, Path(net_file), chosen, links)
    roads = number_roads(links)
    links.sort(key=lambda link: (roads[link.approach], INTENTION_NUMBER[link.intention], *link.order))
    lanes = list({link.lane.getID(): link.lane for link in links}.values())
    lanes.sort(key=lambda lane: (roads[lane.getEdge().getID()], lane.getIndex()))
    ways = [way_upstream(net, chosen, lane, control_zone_m) for lane in lanes]
    footprints = [*FOOTPRINTS, ARTICULATED] if articulated else list(FOOTPRINTS)
    areas = conflict_areas(_swept(links), footprints)
    intersection_map = IntersectionMap(
        intersection=chosen.getID(),
        control_zone_m=control_zone_m,
        lanes=[
            Lane(
                id=lane.getID(),
                approach=roads[lane.getEdge().getID()],
                speed_limit_mps=lane.getSpeed(),
                zone_m=way.zone_m,
            )
            for lane, way in zip(lanes, ways, strict=True)
        ],
        movements=_movements(links, lanes, roads, areas, len(footprints)),
        footprints=footprints,
        areas=areas,
    )
    refuse_short_exits(net, Path(net_file), chosen, links, intersection_map)
    return layout_of(net, intersection_map, links, lanes, ways)


def packaged_map() -> IntersectionMap:
    """The map of the default four-arm scenario, as it comes with the package."""
    text = resources.files("gameopt_sumo").joinpath("maps", "four-arm.json").read_bytes()
    return msgspec.json.decode(text, type=IntersectionMap)


def map_json(intersection_map: IntersectionMap) -> bytes:
    """The map as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(intersection_map), indent=1) + b"\n"


def without_turn_speeds(intersection_map: IntersectionMap) -> IntersectionMap:
    """The same map with no limit on any turn (`--ignore-turn-speed`)."""
    movements = [msgspec.structs.replace(m, turn_speed_mps=None) for m in intersection_map.movements]
    return msgspec.structs.replace(intersection_map, movements=movements)


def _swept(links: list[Link]) -> list[SweptMovement]:
    return [
        SweptMovement(
            lane=link.lane.getID(),
            approach=link.approach,
            exit_lane=link.exit_lane.getID(),
            length_m=link.length_m,
            track=link.track,
            lane_width_m=min(link.lane.getWidth(), link.exit_lane.getWidth()),
        )
        for link in links
    ]


def _movements(
    links: list[Link], lanes: list[Any], roads: dict[str, int], areas: list[ConflictArea], sizes: int
) -> list[Movement]:
    lane_index = {lane.getID(): index for index, lane in enumerate(lanes)}
    groups = [f"{roads[link.approach]}-{INTENTION_NUMBER[link.intention]}" for link in links]
    shared, seen = Counter(groups), Counter[str]()
    movements = []
    for index, (link, group) in enumerate(zip(links, groups, strict=True)):
        movements.append(
            Movement(
                id=f"{group}.{seen[group]}" if shared[group] > 1 else group,
                group=group,
                lane=lane_index[link.lane.getID()],
                exit_lane=link.exit_lane.getID(),
                exit_speed_mps=link.exit_lane.getSpeed(),
                exit_length_m=link.exit_lane.getLength(),
                intention=link.intention,
                length_m=round(link.length_m, 6),
                clear_m=_clear_m(index, link.length_m, areas),
                setback_m=_setback_m(index, areas, sizes),
                turn_speed_mps=_turn_speed_mps(link),
                path=link.track.line(0.0, link.length_m),
            )
        )
        seen[group] += 1
    return movements


def _clear_m(index: int, length_m: float, areas: list[ConflictArea]) -> float:
    """Rear clear of every area, and standing on the exit lane."""
    return round(max([length_m, *(leave for _, leave in _windows_of(index, areas))]), 6)


def _setback_m(index: int, areas: list[ConflictArea], sizes: int) -> list[float]:
    """How far its areas reach back over the stop line, by footprint."""
    return [
        round(max([0.0, *(-entry for entry, _ in _windows_of(index, areas, footprint))]), 6)
        for footprint in range(sizes)
    ]


def _windows_of(index: int, areas: list[ConflictArea], footprint: int | None = None) -> Iterator[Window]:
    for area in areas:
        if index in (area.a, area.b):
            table = area.a_windows_m if area.a == index else area.b_windows_m
            rows = table if footprint is None else [table[footprint]]
            yield from (window for row in rows for window in row if window is not None)


def _turn_speed_mps(link: Link) -> float | None:
    """What SUMO's own drivers keep to within the junction, where it is below the approach lane's limit."""
    limit = float(min(lane.getSpeed() for lane in link.internal))
    return limit if limit < link.lane.getSpeed() - _LIMIT_TOLERANCE_MPS else None
