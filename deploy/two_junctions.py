"""`make two-junctions`: two managers on one Zenoh network, and vehicles that pass both junctions of one SUMO net."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import product
from pathlib import Path

import click
import numpy as np
from demo import drive, end_as_ctrl_c_does, free_port, serving

from gameopt_sumo.demand import arrivals, type_lines
from gameopt_sumo.scenarios import FourArm, build_net

OUT = Path("out/two-junctions")
JUNCTIONS = ("west", "east")
APART_M = 420.0
ARM_M = 400.0
FLOW_VEH_H = 400.0
"""On each way in; every one of them has one lane."""
OTHER = {"west": "east", "east": "west"}
ARMS = {"W": (-1.0, 0.0), "N": (0.0, 1.0), "S": (0.0, -1.0), "E": (1.0, 0.0)}
TOWARDS = {"west": "E", "east": "W"}
CLASSES = FourArm().classes


@click.command()
@click.option("--seconds", type=click.FloatRange(1.0, 86400.0), default=120.0, metavar="S", help="Simulated seconds.")
@click.option("--seed", type=click.IntRange(0), default=1, metavar="N", help="Seed of the arrivals.")
def two_junctions(seconds: float, seed: int) -> None:
    """Run two junctions in lock-step; everything it writes is in out/two-junctions."""
    end_as_ctrl_c_does()
    OUT.mkdir(parents=True, exist_ok=True)
    config = write_scenario(OUT, seconds, seed)
    net = OUT / "two-junctions.net.xml"
    first, second = (f"tcp/127.0.0.1:{free_port(usual)}" for usual in (7447, 7448))
    manager = ["gameopt-im", "serve", "--map", net, "--clock", "lockstep", "--http", "off"]
    with ExitStack() as managers:
        managers.enter_context(serving([*manager, "--junction", "west", "--listen", first], OUT / "west.log"))
        joins = ["--junction", "east", "--listen", second, "--connect", first]
        managers.enter_context(serving([*manager, *joins], OUT / "east.log"))
        vehicles = ["gameopt-vehicles", "--sumo", config, "--clock", "lockstep", "--duration", seconds]
        vehicles += ["--junction", "west", "--junction", "east", "--connect", first]
        started = time.monotonic()
        code = drive([*vehicles, "--report", OUT / "report.json"])
    click.echo(f"The run took {time.monotonic() - started:.0f} s. Reports: {OUT}/report.west.json, report.east.json")
    sys.exit(code)


def write_scenario(folder: Path, duration_s: float, seed: int, apart_m: float = APART_M) -> Path:
    """Net, demand and configuration; returns the .sumocfg."""
    described = {"node": _document("nodes", _nodes(apart_m)), "edge": _document("edges", _edges())}
    build_net(described, folder / "two-junctions.net.xml", ("--no-turnarounds", "true"))
    departures = sorted(_departures(duration_s, seed))
    lines = [
        f'<vehicle id="{kind}.{k}" type="{kind}" depart="{time_s:.2f}" departSpeed="max">'
        f'<route edges="{" ".join(edges)}"/></vehicle>'
        for k, (time_s, kind, edges) in enumerate(departures)
    ]
    (folder / "two-junctions.rou.xml").write_text(_document("routes", [*type_lines(), *lines]))
    config = folder / "two-junctions.sumocfg"
    config.write_text(
        '<configuration><input><net-file value="two-junctions.net.xml"/>'
        '<route-files value="two-junctions.rou.xml"/></input></configuration>\n'
    )
    return config


def _outer(junction: str) -> list[str]:
    """The arms of a junction that do not lead to the other."""
    return [arm for arm in ARMS if arm != TOWARDS[junction]]


def _nodes(apart_m: float) -> Iterator[str]:
    for junction, x in zip(JUNCTIONS, (0.0, apart_m), strict=True):
        yield f'<node id="{junction}" x="{x}" y="0" type="priority" radius="6"/>'
        for arm in _outer(junction):
            along, across = ARMS[arm]
            yield f'<node id="{junction}_{arm}" x="{x + along * ARM_M}" y="{across * ARM_M}" type="dead_end"/>'


def _edges() -> Iterator[str]:
    common = 'numLanes="1" speed="15" priority="1"'
    for junction in JUNCTIONS:
        yield f'<edge id="{junction}_{OTHER[junction]}" from="{junction}" to="{OTHER[junction]}" {common}/>'
        for arm in _outer(junction):
            yield f'<edge id="{junction}_{arm}_in" from="{junction}_{arm}" to="{junction}" {common}/>'
            yield f'<edge id="{junction}_{arm}_out" from="{junction}" to="{junction}_{arm}" {common}/>'


def _ways() -> Iterator[list[str]]:
    """Every way through: over one junction, or over both."""
    for junction in JUNCTIONS:
        other = OTHER[junction]
        for entry in _outer(junction):
            for leave in _outer(junction):
                if leave != entry:
                    yield [f"{junction}_{entry}_in", f"{junction}_{leave}_out"]
            for leave in _outer(other):
                yield [f"{junction}_{entry}_in", f"{junction}_{other}", f"{other}_{leave}_out"]


def _departures(duration_s: float, seed: int) -> Iterator[tuple[float, str, list[str]]]:
    ways = [*_ways()]
    for junction, arm in product(JUNCTIONS, ARMS):
        offered = [way for way in ways if way[0] == f"{junction}_{arm}_in"]
        stream = np.random.default_rng([seed, JUNCTIONS.index(junction), [*ARMS].index(arm)])
        for time_s in arrivals(stream, FLOW_VEH_H, duration_s) if offered else ():
            yield time_s, str(stream.choice([*CLASSES], p=[*CLASSES.values()])), offered[stream.integers(len(offered))]


def _document(root: str, lines: Iterator[str] | list[str]) -> str:
    return "\n".join((f"<{root}>", *lines, f"</{root}>", ""))


if __name__ == "__main__":
    two_junctions()
