"""Scenarios written as one net, one demand and one .sumocfg that plain SUMO runs as well."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from gameopt_sumo.demand import ARMS, VEHICLE_TYPES, Turns, exit_arm, lane_of, routes_xml
from gameopt_sumo.network import read_map
from gameopt_sumo.run_files import NominalDemand
from gameopt_wire.intersection import IntersectionMap

NET_FILE = "four-arm.net.xml"
DEMAND_FILE = "four-arm.rou.xml"
CONFIG_FILE = "four-arm.sumocfg"
JUNCTION = "junction"

APPROACH_M = 420.0
"""Centre to edge end: the 150 m control zone, the half junction, and 250 m upstream for queues."""
EXIT_M = 350.0
SPEED_LIMIT_MPS = 20.0
CORNER_RADIUS_M = {1: 12.0, 2: 9.0, 3: 6.0}
"""Kerb radius by lanes per approach, large enough for a turning truck to keep clear of the lanes beside it.

With three lanes netconvert's limit on lateral acceleration gives right turns 7.5 m/s and left turns 11.0 m/s.
"""

_OUTWARD = {"W": (-1, 0), "E": (1, 0), "N": (0, 1), "S": (0, -1)}
_DEFAULT_CLASSES = MappingProxyType({"car": 0.85, "truck": 0.12, "emergency": 0.03})


class ScenarioError(Exception):
    """A parameter is not allowed or a file cannot be written; one line."""


@dataclass(frozen=True, kw_only=True)
class FourArm:
    """A four-arm intersection and its demand. Flows in veh/h, durations in s; shares add up to 1."""

    flow_veh_h: float = 6000.0
    ratio: float = 1.0
    """Flow of west and east together over that of north and south together."""
    arm_flows_veh_h: tuple[float, float, float, float] | None = None
    """West, east, north, south; replaces `flow_veh_h` and `ratio`."""
    turns: Turns = (0.25, 0.5, 0.25)
    """Shares of right, straight, left."""
    classes: Mapping[str, float] = field(default_factory=lambda: _DEFAULT_CLASSES)
    """Shares of car, truck, emergency, taxi."""
    lanes: int = 3
    """Per approach. 3: one for each intention; 2: right and straight share one; 1: all share one."""
    seed: int = 1
    duration_s: float = 3600.0

    def __post_init__(self) -> None:
        """Raises `ScenarioError` at the first parameter that is not allowed."""
        if not 0.0 < self.flow_veh_h <= 40_000.0:
            raise ScenarioError(f"flow is {self.flow_veh_h:g} veh/h, allowed: above 0 up to 40000")
        if not 0.01 <= self.ratio <= 100.0:
            raise ScenarioError(f"ratio is {self.ratio:g}, allowed: 0.01 to 100 (west-east over north-south)")
        if self.arm_flows_veh_h is not None:
            if len(self.arm_flows_veh_h) != len(ARMS):
                raise ScenarioError("arm-flows needs four values: W,E,N,S in veh/h")
            if not (all(0.0 <= f <= 10_000.0 for f in self.arm_flows_veh_h) and any(self.arm_flows_veh_h)):
                raise ScenarioError("arm-flows must each be 0 to 10000 veh/h, at least one above 0")
        _check_shares("turns", self.turns, "right,straight,left")
        if unknown := set(self.classes) - set(VEHICLE_TYPES):
            raise ScenarioError(f"classes has {min(unknown)!r}, allowed: {', '.join(VEHICLE_TYPES)}")
        _check_shares("classes", tuple(self.classes.values()), "car=.85,truck=.12,emergency=.03")
        if self.lanes not in (1, 2, 3):
            raise ScenarioError(f"lanes is {self.lanes}, allowed: 1, 2, 3")
        if self.seed < 0:
            raise ScenarioError(f"seed is {self.seed}, allowed: 0 or above")
        if not 0.0 < self.duration_s <= 86_400.0:
            raise ScenarioError(f"duration is {self.duration_s:g} s, allowed: above 0 up to 86400")

    @property
    def flow_by_arm_veh_h(self) -> dict[str, float]:
        """Flow on each approach: half of its road's share."""
        if self.arm_flows_veh_h is not None:
            return dict(zip(ARMS, self.arm_flows_veh_h, strict=True))
        west_east = 0.5 * self.flow_veh_h * self.ratio / (1.0 + self.ratio)
        north_south = 0.5 * self.flow_veh_h / (1.0 + self.ratio)
        return {"W": west_east, "E": west_east, "N": north_south, "S": north_south}

    @property
    def demand(self) -> NominalDemand:
        """Total flow and ratio, however they were given; no ratio where nobody comes from north and south."""
        arms = self.flow_by_arm_veh_h
        west_east, north_south = arms["W"] + arms["E"], arms["N"] + arms["S"]
        ratio = west_east / north_south if north_south > 0.0 else None
        return NominalDemand(round(west_east + north_south, 6), None if ratio is None else round(ratio, 6))


def _check_shares(name: str, shares: tuple[float, ...], example: str) -> None:
    # Written so that NaN fails too.
    in_range = all(0.0 <= share <= 1.0 for share in shares)
    if not (shares and in_range and abs(sum(shares) - 1.0) <= 1e-6):
        raise ScenarioError(f"{name} must be shares that add up to 1, e.g. {example}")
    if name == "turns" and len(shares) != 3:
        raise ScenarioError(f"{name} needs three shares: {example}")


def write_four_arm(scenario: FourArm, directory: Path) -> Path:
    """Write net, demand and configuration into `directory`; returns the .sumocfg. Raises `ScenarioError`.

    The same parameters give the same bytes.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        write_net(scenario.lanes, directory / NET_FILE)
        demand = routes_xml(
            flows_veh_h=scenario.flow_by_arm_veh_h,
            turns=scenario.turns,
            classes=scenario.classes,
            lanes=scenario.lanes,
            seed=scenario.seed,
            duration_s=scenario.duration_s,
        )
        (directory / DEMAND_FILE).write_text(f"{scenario.demand.note()}\n{demand}", encoding="utf-8")
        config = directory / CONFIG_FILE
        config.write_text(_CONFIG.format(net=NET_FILE, demand=DEMAND_FILE), encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{directory}: cannot write: {error.strerror or error}") from None
    return config


_CONFIG = """<?xml version="1.0" encoding="UTF-8"?>
<configuration>
    <input>
        <net-file value="{net}"/>
        <route-files value="{demand}"/>
    </input>
    <time>
        <begin value="0"/>
        <step-length value="0.1"/>
    </time>
    <processing>
        <step-method.ballistic value="true"/>
        <collision.action value="warn"/>
        <collision.check-junctions value="true"/>
        <collision.mingap-factor value="0"/>
        <time-to-teleport value="-1"/>
    </processing>
</configuration>
"""


def write_net(lanes: int, net_file: Path) -> None:
    """Build the net with netconvert. Raises `ScenarioError` if netconvert is missing or fails."""
    described = {"node": _nodes_xml(lanes), "edge": _edges_xml(lanes), "connection": _connections_xml(lanes)}
    build_net(described, net_file, ("--no-turnarounds", "true"))


def build_net(described: Mapping[str, str], net_file: Path, options: Sequence[str] = ()) -> None:
    """A net from plain descriptions, XML by kind: node, edge, connection.

    Raises `ScenarioError` if netconvert is missing or fails.
    """
    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        arguments = []
        for kind, text in described.items():
            file = Path(scratch, f"{kind}.xml")
            file.write_text(text, encoding="utf-8")
            arguments += [f"--{kind}-files", str(file)]
        netconvert((*arguments, *options, "--junctions.internal-link-detail", "20"), net_file)


def netconvert(arguments: Sequence[str], net_file: Path) -> None:
    """Write the net that netconvert makes of `arguments`, without the date and the paths of its input.

    Raises `ScenarioError` if netconvert is missing or fails.
    """
    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        made = Path(scratch, "net.xml")
        command = [sumo_binary("netconvert"), "--output-file", str(made), *arguments]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode != 0:
            lines = result.stderr.strip().splitlines()
            raise ScenarioError(f"netconvert failed: {lines[0] if lines else 'no message'}")
        net = made.read_text(encoding="utf-8")
    # netconvert opens its file with a comment that names the date and the paths of its input.
    net_file.write_text(re.sub(r"<!--.*?-->\s*", "", net, flags=re.DOTALL), encoding="utf-8")


def four_arm_map() -> IntersectionMap:
    """The map of the default four-arm net; `maps/four-arm.json` is this one."""
    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        net_file = Path(scratch, NET_FILE)
        write_net(FourArm().lanes, net_file)
        return read_map(net_file)


def sumo_binary(name: str) -> str:
    """One of SUMO's programs, from the eclipse-sumo package or PATH. Raises `ScenarioError`."""
    try:
        import sumo  # type: ignore[import-untyped]

        packaged = shutil.which(name, path=str(Path(sumo.SUMO_HOME, "bin")))
    except ImportError:
        packaged = None
    found = packaged or shutil.which(name)
    if found is None:
        raise ScenarioError(f"{name} not found: install eclipse-sumo, or put SUMO's programs on PATH")
    return found


def _nodes_xml(lanes: int) -> str:
    # A priority junction: its links have foes, so SUMO's own check of junction collisions sees them.
    lines = [f'<node id="{JUNCTION}" x="0" y="0" type="priority" radius="{CORNER_RADIUS_M[lanes]}"/>']
    for arm, (x, y) in _OUTWARD.items():
        lines.append(f'<node id="{arm}_from" x="{x * APPROACH_M}" y="{y * APPROACH_M}" type="dead_end"/>')
        lines.append(f'<node id="{arm}_to" x="{x * EXIT_M}" y="{y * EXIT_M}" type="dead_end"/>')
    return _document("nodes", lines)


def _edges_xml(lanes: int) -> str:
    common = f'numLanes="{lanes}" speed="{SPEED_LIMIT_MPS}" priority="1"'
    lines = []
    for arm in ARMS:
        lines.append(f'<edge id="{arm}_in" from="{arm}_from" to="{JUNCTION}" {common}/>')
        lines.append(f'<edge id="{arm}_out" from="{JUNCTION}" to="{arm}_to" {common}/>')
    return _document("edges", lines)


def _connections_xml(lanes: int) -> str:
    """Each lane to the exit lane of its own index, so that with three lanes no two movements merge."""
    lines = []
    for arm in ARMS:
        for intention in range(3):
            lane = lane_of(intention, lanes)
            to = exit_arm(arm, intention)
            lines.append(f'<connection from="{arm}_in" to="{to}_out" fromLane="{lane}" toLane="{lane}"/>')
    return _document("connections", lines)


def _document(root: str, lines: list[str]) -> str:
    return "\n".join((f"<{root}>", *(f"    {line}" for line in lines), f"</{root}>", ""))
