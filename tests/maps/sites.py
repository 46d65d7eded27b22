"""Junctions nobody here drew: some from the SUMO package, some built from plain descriptions; and demand for them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import sumo
from plain_nets import CENTRE, build_plain

from gameopt_sumo.demand import arrivals, type_lines
from gameopt_sumo.junction import choose, links_over, read_net

SHIPPED = {
    "cross": ("game/cross/cross.net.xml", "0"),
    "rilsa-1": ("sumolib/scenario/scenarios/RealWorld/RiLSA_example1/net.net.xml", "0"),
    "rilsa-3": ("sumolib/scenario/scenarios/RealWorld/RiLSA_example3/net.net.xml", "0"),
    "square": ("game/square/square.net.xml", "A0"),
}
"""Nets of the SUMO package, below its tools folder, and the junction."""
SHARES = {"right": 1.0, "straight": 2.0, "left": 1.0, "turnaround": 0.1}
CLASSES = {"car": 0.85, "truck": 0.12, "emergency": 0.03}


@dataclass(frozen=True)
class Site:
    """A junction and every way over it: (edges, share of the demand)."""

    name: str
    net: Path
    junction: str
    ways: tuple[tuple[tuple[str, ...], float], ...]
    lanes: int

    def scenario(self, folder: Path, flow_veh_h: float, seed: int, duration_s: float) -> Path:
        """Poisson arrivals on every way; the same for whoever controls the junction."""
        folder.mkdir(parents=True, exist_ok=True)
        departures = []
        for number, (edges, share) in enumerate(self.ways):
            stream = np.random.default_rng([seed, number])
            for time_s in arrivals(stream, flow_veh_h * share, duration_s):
                kind = str(stream.choice(list(CLASSES), p=list(CLASSES.values())))
                departures.append((time_s, number, kind, edges))
        lines = ["<routes>", *type_lines()]
        for k, (time_s, _, kind, edges) in enumerate(sorted(departures)):
            lines.append(
                f'<vehicle id="{kind}.{k}" type="{kind}" depart="{time_s:.2f}" departLane="best" departSpeed="max">'
                f'<route edges="{" ".join(edges)}"/></vehicle>'
            )
        (folder / "demand.rou.xml").write_text("\n".join((*lines, "</routes>\n")))
        config = folder / f"{self.name}.sumocfg"
        config.write_text(
            f'<configuration><input><net-file value="{self.net.resolve()}"/><route-files value="demand.rou.xml"/>'
            '</input><output><tripinfo-output value="trips.xml"/></output></configuration>\n'
        )
        return config


def site(name: str, folder: Path) -> Site:
    """One of them; a plain one is built by netconvert, into `folder`."""
    if name in SHIPPED:
        path, junction = SHIPPED[name]
        return _site(name, Path(sumo.SUMO_HOME, "tools", path), junction)
    folder.mkdir(parents=True, exist_ok=True)
    return _site(name, build_plain(name, folder), CENTRE)


def _site(name: str, net_file: Path, junction: str) -> Site:
    net = read_net(net_file)
    node = choose(net, net_file, junction)
    shares: dict[tuple[str, ...], float] = {}
    lanes: dict[str, int] = {}
    for link in links_over(net, node):
        approach, leaving = link.lane.getEdge(), link.exit_lane.getEdge()
        lanes[link.approach] = approach.getLaneNumber()
        shares[(*_way_in(approach), *_way_out(leaving))] = SHARES[link.intention] * approach.getLaneNumber()
    of_approach = {arm: sum(s for edges, s in shares.items() if arm in edges) for arm in lanes}
    ways = []
    for edges, share in sorted(shares.items()):
        arm = next(edge for edge in edges if edge in lanes)
        ways.append((edges, share / of_approach[arm] * lanes[arm] / sum(lanes.values())))
    return Site(name, net_file, junction, tuple(ways), sum(lanes.values()))


def _way_in(edge: Any) -> list[str]:
    """From where a road begins, or from the nearest junction where several meet."""
    before = [
        other for other in edge.getIncoming() if not other.isSpecial() and other.getFromNode() is not edge.getToNode()
    ]
    return [*(_way_in(before[0]) if len(before) == 1 else []), edge.getID()]


def _way_out(edge: Any) -> list[str]:
    after = [
        other for other in edge.getOutgoing() if not other.isSpecial() and other.getToNode() is not edge.getFromNode()
    ]
    return [edge.getID(), *(_way_out(after[0]) if len(after) == 1 else [])]
