"""The scenario's net under another control: the same lanes, so that the same arrivals drive on it."""

from __future__ import annotations

import shutil
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Literal, NamedTuple

from gameopt_sumo.baselines.lights import program, signals
from gameopt_sumo.baselines.plan import BaselineError, Plan
from gameopt_sumo.junction import choose, links_over, read_net
from gameopt_sumo.scenarios import netconvert

_TOLERANCE_M = 0.03
"""netconvert writes lengths to 0.01 m; a left turn that may wait half way is two lanes."""


class Way(NamedTuple):
    """A lane, or the lanes of one movement over the junction."""

    length_m: float
    speed_mps: float


def lights(net_file: Path, junction: str | None, plan: Plan, out: Path) -> None:
    """Write the net with lights that follow `plan`.

    Raises `PlanError`, `BaselineError`, `NetworkError`, `ScenarioError`.
    """
    name = str(choose(read_net(net_file), net_file, junction).getID())
    _rebuild(net_file, name, "traffic_light", out)
    net = read_net(out)
    node = net.getNode(name)
    light = str(node.getTLSID())
    served = [link for link in net.getTLS(light).getConnections() if link[0].getEdge().getToNode() is not node]
    if served:
        raise BaselineError(f"{net_file}: the lights of {name!r} serve other junctions too")
    tree = ET.parse(out)
    root = tree.getroot()
    for old in root.findall("tlLogic"):
        if old.get("id") == light:
            width = len(old.find("phase").get("state"))  # type: ignore[union-attr,arg-type]
            at = list(root).index(old)
            root.remove(old)
    root.insert(at, program(signals(net, node), light, width, plan))
    tree.write(out, encoding="unicode", xml_declaration=True)
    same_ground(net_file, out, name)


def all_way_stop(net_file: Path, junction: str | None, out: Path) -> None:
    """Write the net with an all-way stop. Raises `BaselineError`, `NetworkError`, `ScenarioError`."""
    name = str(choose(read_net(net_file), net_file, junction).getID())
    _rebuild(net_file, name, "allway_stop", out)
    same_ground(net_file, out, name)


def _rebuild(net_file: Path, junction: str, kind: Literal["traffic_light", "allway_stop"], out: Path) -> None:
    if read_net(net_file).getNode(junction).getType() == kind:
        shutil.copyfile(net_file, out)
        return
    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        patch = Path(scratch, "node.xml")
        patch.write_text(f'<nodes><node id="{junction}" type="{kind}"/></nodes>\n', encoding="utf-8")
        netconvert(("--sumo-net-file", str(net_file), "--node-files", str(patch)), out)


def ground(net_file: Path, junction: str) -> dict[str, Way]:
    """Every lane outside junctions, and every movement over this one: length and speed limit."""
    net = read_net(net_file)
    ways = {lane.getID(): Way(lane.getLength(), lane.getSpeed()) for e in net.getEdges() for lane in e.getLanes()}
    ways = {lane: way for lane, way in ways.items() if not lane.startswith(":")}
    return ways | {_name(link): _over(link) for link in links_over(net, net.getNode(junction))}


def _name(link: Any) -> str:
    return f"{link.lane.getID()} -> {link.exit_lane.getID()}"


def _over(link: Any) -> Way:
    return Way(link.length_m, min(lane.getSpeed() for lane in link.internal))


def same_ground(before: Path, after: Path, junction: str) -> None:
    """Whoever drives must find the same road. Raises `BaselineError` at the first lane that differs."""
    old, new = ground(before, junction), ground(after, junction)
    for name in sorted(old.keys() | new.keys()):
        a, b = old.get(name), new.get(name)
        if a is None or b is None or max(abs(p - q) for p, q in zip(a, b, strict=True)) > _TOLERANCE_M:
            raise BaselineError(f"{before}: netconvert changes {name} from {a} to {b}; no comparison is possible")
