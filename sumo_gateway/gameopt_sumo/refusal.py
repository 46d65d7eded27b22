"""Junctions that no manager of vehicles can run: others cross there, who neither bid nor obey, or there is no room."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import shapely

from gameopt_sumo.junction import MANAGED_CLASSES, Link, NetworkError, internal_lanes, links_over
from gameopt_wire.intersection import IntersectionMap

_NAMED = {"bicycle": "a cycle path", "ship": "a waterway"}
"""What a path open to none of the managed classes is called, by a class it is open to; else it is a railway's."""
_RAIL = ("rail", "rail_urban", "rail_electric", "rail_fast", "tram", "subway", "cable_car")


def refuse_foreign_paths(net: Any, net_file: Path, node: Any, links: Sequence[Link]) -> None:
    """Raise `NetworkError` where a pedestrian crossing, a railway or a cycle path crosses a movement of `node`."""
    movements = shapely.union_all([shapely.LineString(link.shape) for link in links])
    for name, what, shape in (*pedestrian_crossings(net, node), *foreign_paths(net, node)):
        if shapely.LineString(shape).intersects(movements):
            raise NetworkError(
                f"{net_file}: junction {node.getID()!r}: {what} ({name!r}) crosses its movements; "
                "only junctions that vehicles alone cross can be managed"
            )


def refuse_short_exits(
    net: Any, net_file: Path, node: Any, links: Sequence[Link], intersection: IntersectionMap
) -> None:
    """Raise `NetworkError` where an exit ends at another junction before a vehicle stands clear of this one.

    Vehicles are given back to SUMO at the end of an exit, and may have to wait there. `links` are the map's movements.
    """
    longest_m = max(body.length_m for body in intersection.footprints)
    for link, movement in zip(links, intersection.movements, strict=True):
        needed_m = movement.clear_m - movement.length_m + longest_m
        edge = link.exit_lane.getEdge()
        if movement.exit_length_m < needed_m and links_over(net, edge.getToNode()):
            raise NetworkError(
                f"{net_file}: junction {node.getID()!r}: exit {edge.getID()!r} is {movement.exit_length_m:.1f} m long; "
                f"{needed_m:.1f} m or more are allowed, for a vehicle of {longest_m:g} m to stand clear of the junction"
            )


def pedestrian_crossings(net: Any, node: Any) -> Iterator[tuple[str, str, Any]]:
    """Name, kind and shape of each crossing over an arm of the junction."""
    for edge in net.getEdges(withInternal=True):
        if edge.getFunction() == "crossing" and edge.getToNode() is node:
            yield edge.getID(), "a pedestrian crossing", edge.getLanes()[0].getShape()


def foreign_paths(net: Any, node: Any) -> Iterator[tuple[str, str, Any]]:
    """The paths over the junction that are open to vehicles, but to none that can be managed."""
    for edge in node.getIncoming():
        for lane in () if edge.isSpecial() else edge.getLanes():
            for connection in lane.getOutgoing():
                onto = connection.getToLane()
                open_to = [c for c in (*_RAIL, *_NAMED) if all(way.allows(c) for way in (lane, onto, connection))]
                managed = any(all(way.allows(c) for way in (lane, onto, connection)) for c in MANAGED_CLASSES)
                inside = internal_lanes(net, connection)
                if inside and open_to and not managed:
                    shape = [point for inner in inside for point in inner.getShape()]
                    yield inside[0].getID(), _NAMED.get(open_to[0], "a railway"), shape
