"""A four-arm junction with many lanes, for as many vehicles as no real junction sees at a time."""

from __future__ import annotations

from pathlib import Path

from gameopt_sumo.scenarios import APPROACH_M, EXIT_M, SPEED_LIMIT_MPS, build_net

LANES = 12
"""Per arm: a quarter each turns right and left. 48 lanes of 150 m hold 1,000 vehicles, those on the exits included."""
_RADIUS_M = 20.0
_ARMS = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""Outward, clockwise from the west."""


def write_net(net_file: Path, lanes: int = LANES) -> None:
    """The net; every lane leads to the exit lane of its own index, so no two movements merge."""
    nodes = [f'<node id="junction" x="0" y="0" type="priority" radius="{_RADIUS_M}"/>']
    edges, connections = [], []
    common = f'numLanes="{lanes}" speed="{SPEED_LIMIT_MPS}" priority="1"'
    for arm, (x, y) in enumerate(_ARMS):
        nodes.append(f'<node id="{arm}_from" x="{x * APPROACH_M}" y="{y * APPROACH_M}" type="dead_end"/>')
        nodes.append(f'<node id="{arm}_to" x="{x * EXIT_M}" y="{y * EXIT_M}" type="dead_end"/>')
        edges.append(f'<edge id="{arm}_in" from="{arm}_from" to="junction" {common}/>')
        edges.append(f'<edge id="{arm}_out" from="junction" to="{arm}_to" {common}/>')
        for lane in range(lanes):
            to = _exit(arm, lane, lanes)
            connections.append(f'<connection from="{arm}_in" to="{to}_out" fromLane="{lane}" toLane="{lane}"/>')
    described = {"node": ("nodes", nodes), "edge": ("edges", edges), "connection": ("connections", connections)}
    documents = {kind: "\n".join((f"<{root}>", *lines, f"</{root}>")) for kind, (root, lines) in described.items()}
    build_net(documents, net_file, ("--no-turnarounds", "true"))


def _exit(arm: int, lane: int, lanes: int) -> int:
    """The arm that a lane leads to; lane 0 is the rightmost."""
    quarter = lanes // 4
    turn = -1 if lane < quarter else 1 if lane >= lanes - quarter else 2
    return (arm + turn) % len(_ARMS)
