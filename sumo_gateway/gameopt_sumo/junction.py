"""One junction of a SUMO net: which it is, the connections over it, the numbers of its roads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.sax import SAXException

import shapely
from sumolib.net import readNet

from gameopt_sumo.geometry import Track
from gameopt_wire.intersection import Intention

MANAGED_CLASSES = ("passenger", "truck", "bus", "emergency")
"""A lane or connection open to none of these (a footpath, a tramway) is no part of the map."""
_INTENTIONS: dict[str, Intention] = {
    "s": "straight",
    "r": "right",
    "R": "right",
    "l": "left",
    "L": "left",
    "t": "turnaround",
    "T": "turnaround",
}
_OPPOSITE_TOLERANCE_DEG = 50.0


class NetworkError(Exception):
    """The net cannot be read as an intersection; one line that says what, where and what is allowed."""


@dataclass(frozen=True)
class Link:
    """One connection over the junction: approach lane, the internal lanes it runs on, exit lane."""

    lane: Any
    internal: list[Any]
    exit_lane: Any
    intention: Intention

    @property
    def approach(self) -> str:
        """The edge of its approach lane."""
        return str(self.lane.getEdge().getID())

    @property
    def order(self) -> tuple[int, str, int]:
        """Movements of one intention go by lane from the right, then by where they lead."""
        return self.lane.getIndex(), self.exit_lane.getEdge().getID(), self.exit_lane.getIndex()

    @property
    def track(self) -> Track:
        """Approach lane, internal lanes and exit lane as one line."""
        sections = [(lane.getLength(), lane.getShape()) for lane in (self.lane, *self.internal, self.exit_lane)]
        return Track(sections, -self.lane.getLength())

    @property
    def length_m(self) -> float:
        return float(sum(lane.getLength() for lane in self.internal))

    @property
    def shape(self) -> list[tuple[float, float]]:
        return [point for lane in self.internal for point in lane.getShape()]


def read_net(net_file: Path) -> Any:
    if not net_file.is_file():
        raise NetworkError(f"{net_file}: no such file; a SUMO net (.net.xml) is needed")
    try:
        net = readNet(str(net_file), withInternal=True)
        nodes = net.getNodes()
    except (SAXException, UnicodeDecodeError, OSError) as error:
        raise NetworkError(f"{net_file}: not a SUMO net: {_one_line(error)}") from None
    except Exception as error:  # noqa: BLE001 - the reader trips over incomplete nets in many ways
        reason = f"{type(error).__name__}: {_one_line(error)}"
        raise NetworkError(f"{net_file}: broken SUMO net: {reason}") from None
    if not nodes:
        raise NetworkError(f"{net_file}: not a SUMO net: it has no junction")
    return net


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def choose(net: Any, net_file: Path, junction: str | None) -> Any:
    """The junction named, or the only candidate."""
    if junction is not None:
        if net.hasNode(junction):
            return net.getNode(junction)
        raise NetworkError(f"{net_file}: no junction {junction!r}; candidates: {_listing(_candidates(net))}")
    candidates = _candidates(net)
    if len(candidates) != 1:
        found = "no junction with crossing movements" if not candidates else f"{len(candidates)} candidates"
        raise NetworkError(f"{net_file}: {found}; name one with --junction: {_listing(candidates)}")
    return candidates[0]


def _listing(candidates: list[Any], most: int = 12) -> str:
    names = sorted(node.getID() for node in candidates)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more


def _candidates(net: Any) -> list[Any]:
    """Junctions where movements of different approaches cross; turning back does not count."""
    return [node for node in net.getNodes() if node.getType() != "internal" and _has_crossing(net, node)]


def _has_crossing(net: Any, node: Any) -> bool:
    if len([edge for edge in node.getIncoming() if not edge.isSpecial()]) < 2:
        return False
    lines = [
        (link.approach, shapely.LineString(link.shape))
        for link in links_over(net, node)
        if link.intention != "turnaround" and len(link.shape) > 1
    ]
    return any(a != b and line.crosses(other) for (a, line), (b, other) in combinations(lines, 2))


def links_over(net: Any, node: Any) -> list[Link]:
    """Every connection over the junction that road vehicles may use."""
    links = []
    for edge in node.getIncoming():
        if edge.isSpecial():
            continue
        for lane in edge.getLanes():
            for connection in lane.getOutgoing():
                internal = internal_lanes(net, connection)
                usable = any(
                    lane.allows(c) and connection.getToLane().allows(c) and connection.allows(c)
                    for c in MANAGED_CLASSES
                )
                if internal and usable:
                    intention = _INTENTIONS.get(connection.getDirection(), "straight")
                    links.append(Link(lane, internal, connection.getToLane(), intention))
    return links


def internal_lanes(net: Any, connection: Any) -> list[Any]:
    """The lanes within the junction, through its internal junctions (where left turners may wait)."""
    lanes = []
    via = connection.getViaLaneID()
    while via:
        lanes.append(net.getLane(via))
        onward = lanes[-1].getOutgoing()
        via = onward[0].getViaLaneID() if onward else ""
    return lanes


def number_roads(links: list[Link]) -> dict[str, int]:
    """Road numbers x of the groups x-y.

    The paper's table has 0 opposite 1 and 2 opposite 3, with 2 the next road clockwise from 0. So: the road
    nearest to the west is 0, its opposite 1, then the next clockwise that has no number yet, and its
    opposite. With four arms this makes west, east, north, south 0, 1, 2, 3.
    """
    bearing = {link.approach: _bearing_deg(link.lane) for link in links}
    west = 270.0
    start = min(bearing, key=lambda edge: (abs(_turn_deg(bearing[edge], west)), edge))
    free = sorted(bearing, key=lambda edge: ((bearing[edge] - bearing[start]) % 360.0, edge))
    numbers: dict[str, int] = {}
    while free:
        road = free.pop(0)
        numbers[road] = len(numbers)
        across = bearing[road] + 180.0
        opposite = min(free, key=lambda edge: abs(_turn_deg(bearing[edge], across)), default=None)
        if opposite is not None and abs(_turn_deg(bearing[opposite], across)) <= _OPPOSITE_TOLERANCE_DEG:
            free.remove(opposite)
            numbers[opposite] = len(numbers)
    return numbers


def _bearing_deg(lane: Any) -> float:
    """Where the approach lies as seen from the junction, clockwise from north."""
    (x0, y0), (x1, y1) = lane.getShape()[-2:]
    return math.degrees(math.atan2(x0 - x1, y0 - y1)) % 360.0


def _turn_deg(a: float, b: float) -> float:
    return (a - b + 180.0) % 360.0 - 180.0
