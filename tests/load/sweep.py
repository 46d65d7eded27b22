"""Run the real system, manager and vehicles as two processes in lock-step, over flows and seeds; tabulate the reports.

    python tests/load/sweep.py --flows 2000,4000,6000 --seeds 101-103 --duration 360 --warmup 60 --out out/figures

Every run leaves its report in the output folder; a run that is there already is not run again. Ends with exit 1
if any run failed or any vehicles collided.
"""

from __future__ import annotations

import json
import platform
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import track

from gameopt_sumo.compare.processes import BIN, Processes
from gameopt_sumo.compare.results import figure
from gameopt_sumo.figures import COLLISIONS

LIBRARIES = ("gameopt", "eclipse-zenoh", "osqp", "libsumo", "numpy", "numba")


@dataclass(frozen=True)
class Run:
    """One run of the real system."""

    flow: int
    seed: int
    duration: int
    warmup: int
    profile: str
    geometry: str
    workers: int
    clock: str
    ratio: float
    noise: float
    inflate: float
    out: Path

    @property
    def folder(self) -> Path:
        """Where its files go."""
        plain = f"{self.profile}-{self.geometry}-{self.clock}-{self.flow}-{self.seed}-{self.duration}"
        special = (("ratio", self.ratio, 1.0), ("noise", self.noise, 0.0), ("inflate", self.inflate, 0.0))
        return self.out / (plain + "".join(f"-{name}{value:g}" for name, value, usual in special if value != usual))

    def report(self) -> dict[str, Any]:
        """Its report, from disk or by running it; one of a run that was interrupted does not count."""
        path = self.folder / "report.json"
        if not (path.exists() and self._whole(path)):
            path.unlink(missing_ok=True)
            self._run(path)
            assert self._whole(path), f"{path} is the report of an interrupted run"
        return dict(json.loads(path.read_text()))

    def _whole(self, path: Path) -> bool:
        return bool(json.loads(path.read_text())["duration_s"] >= self.duration - 0.05)

    def _run(self, path: Path) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        scenario = [
            "scenario",
            "four-arm",
            "--flow",
            str(self.flow),
            "--seed",
            str(self.seed),
            "--ratio",
            str(self.ratio),
        ]
        _check([BIN / "gameopt-sumo", *scenario, "--duration", str(self.duration), "--out", str(self.folder)])
        common = ["--clock", self.clock]
        serve = [*common, "--profile", self.profile, "--geometry", self.geometry, "--workers", str(self.workers)]
        drive = [
            *common, "--sumo", self.folder / "four-arm.sumocfg", "--duration", str(self.duration),
            "--warmup", str(self.warmup), "--seed", str(self.seed), "--report", path,
            "--tracking-noise", str(self.noise), "--inflate", str(self.inflate),
        ]  # fmt: skip
        Processes().two(serve, drive, self.folder)


def _check(command: list[Any]) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if last else [int(part) for part in text.split(",")]


def row(flow: int, reports: list[dict[str, Any]]) -> str:
    """One line of the table: means over the seeds, with 95 % intervals, and maxima where they count."""

    def mean(*path: str) -> float:
        return statistics.fmean(_at(report, *path) for report in reports)

    def interval(path: str, digits: int) -> str:
        found = figure(reports, path)
        if found is None:
            return "-"
        return f"{found.mean:.{digits}f}" + ("" if found.half is None else f" ± {found.half:.{digits}f}")

    def most(*path: str) -> float:
        return max(_at(report, *path) for report in reports)

    served = [
        _at(r, "vehicles", "arrived") - _at(r, "vehicles", "crossed") - _at(r, "vehicles", "in_zone") for r in reports
    ]
    collisions = sum(_at(r, "safety", "collisions_sumo") + _at(r, "safety", "collisions_geometric") for r in reports)
    solved, failed, late = (sum(_at(r, "qp", name) for r in reports) for name in ("solved", "failed", "late"))
    return (
        f"| {flow:,} | {len(reports)} | {mean('vehicles', 'arrived'):.0f} | {mean('throughput_veh_min'):.1f} "
        f"| {max(served):.0f} | {interval('time_to_goal_s.mean', 2)} "
        f"| {most('time_to_goal_s', 'mean'):.2f} | {mean('by_class', 'emergency', 'time_to_goal_s'):.2f} "
        f"| {most('time_loss_s', 'max'):.1f} | {interval('fuel_g', 1)} | {collisions:.0f} "
        f"| {min(_at(r, 'safety', 'min_pet_s') for r in reports):.2f} | {mean('safety', 'hard_brakes'):.1f} "
        f"| {most('control_cycle', 'missed'):.0f} | {mean('control_cycle', 'p50_ms'):.1f} / "
        f"{most('control_cycle', 'p99_ms'):.1f} | {solved:.0f} / {failed:.0f} / {late:.0f} |"
    )


def _at(report: dict[str, Any], *path: str) -> float:
    value: Any = report
    for name in path:
        value = value[name]
    return float(value) if value is not None else float("nan")


HEADER = (
    "| veh/h | seeds | arrived | veh/min | left waiting, most | time-to-goal s | worst seed | emergency s "
    "| time loss max s | fuel g | collisions | least PET s | hard brakes | missed | cycle ms p50 / p99 "
    "| QPs solved / failed / late |\n"
    "|" + " ---: |" * 16
)


@click.command(context_settings={"show_default": True})
@click.option("--flows", default="2000,4000,6000", help="Demands, veh/h.")
@click.option("--seeds", default="101-103", help="Seeds: FIRST-LAST, or a list.")
@click.option("--duration", default=360, help="Simulated seconds, warm-up included.")
@click.option("--warmup", default=60, help="Simulated seconds before measuring.")
@click.option("--profile", type=click.Choice(["default", "paper"]), default="default")
@click.option("--geometry", type=click.Choice(["areas", "box"]), default="areas")
@click.option("--clock", type=click.Choice(["lockstep", "wall"]), default="lockstep")
@click.option("--workers", default=1, help="Solver processes of the manager.")
@click.option("--ratio", default=1.0, help="Demand of one road to that of the other.")
@click.option("--noise", default=0.0, help="Sigma of the vehicles' speed tracking, m/s.")
@click.option("--inflate", default=0.0, help="Grow bodies by this in the geometric check, m.")
@click.option("--jobs", default=2, help="Runs at a time.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/figures"))
def main(flows: str, seeds: str, jobs: int, out: Path, **settings: Any) -> None:
    """Run every flow with every seed and print a Markdown table."""
    runs = [Run(flow=int(flow), seed=seed, out=out, **settings) for flow in flows.split(",") for seed in _seeds(seeds)]
    with ThreadPoolExecutor(jobs) as pool:
        reports = list(track(pool.map(Run.report, runs), "runs", len(runs), console=Console(stderr=True)))
    by_flow: dict[int, list[dict[str, Any]]] = {}
    for run, report in zip(runs, reports, strict=True):
        by_flow.setdefault(run.flow, []).append(report)
    versions = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    click.echo(f"`{' '.join(['python', *sys.argv])}`\n")
    click.echo(f"{datetime.now(UTC):%Y-%m-%d}; Python {platform.python_version()}, {versions}\n")
    click.echo(HEADER)
    for flow, group in by_flow.items():
        click.echo(row(flow, group))
    sys.exit(any(_at(r, "safety", name) for r in reports for name in COLLISIONS))


if __name__ == "__main__":
    main()
