"""Junctions nobody here drew: the real system against the net's own control, same arrivals, same measuring.

    python tests/load/any_junction.py --seeds 101-103 --duration 360 --warmup 60 --out out/any-junction

For each net the capacity of its own control is found first: demand is raised until SUMO alone leaves vehicles
waiting. Then half of it and nine tenths of it are driven by either. Every run leaves its report in the output folder;
a run that is there already is not run again. Ends with exit 1 if any run failed or any vehicles collided.
"""

from __future__ import annotations

import json
import platform
import statistics
import subprocess
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
from sweep import LIBRARIES

sys.path.append(str(Path(__file__).parents[1] / "maps"))
from plain_nets import NAMES
from sites import SHIPPED, Site, site

from gameopt_sumo.compare.processes import Processes
from gameopt_sumo.exit_codes import EXIT_COLLIDED
from gameopt_sumo.figures import COLLISIONS

STEP = 1.2
"""Demand is raised by this factor while capacity is looked for."""
WAITING = 0.05
STANDING = 0.25
"""A control is saturated once more than the first share cannot enter the zone, or more than the second stays in it."""


@dataclass(frozen=True)
class Run:
    """One site under one control."""

    site: Site
    ours: bool
    flow: int
    seed: int
    duration: int
    warmup: int
    out: Path

    @property
    def folder(self) -> Path:
        """Where its files go."""
        return self.out / f"{self.site.name}-{'ours' if self.ours else 'own'}-{self.flow}-{self.seed}-{self.duration}"

    def report(self) -> dict[str, Any]:
        """Its report, from disk or by running it, with the mean time loss of whole trips beside it."""
        path = self.folder / "report.json"
        if not path.exists():
            config = self.site.scenario(self.folder, self.flow, self.seed, self.duration)
            if self.ours:
                self._drive(config, path)
            else:
                self._watch(config, path)
        report = dict(json.loads(path.read_text()))
        report["trip_loss_s"] = _trip_loss_s(self.folder / "trips.xml", self.warmup)
        return report

    def _drive(self, config: Path, path: Path) -> None:
        common = ["--clock", "lockstep", "--junction", self.site.junction]
        serve = [*common, "--map", self.site.net, "--workers", "1"]
        Processes().two(serve, [*common, "--sumo", config, *self._times(), "--report", path], self.folder)

    def _watch(self, config: Path, path: Path) -> None:
        """The net's own control; what collides there is in its report."""
        own = [sys.executable, "-m", "gameopt_sumo.baselines", "run", str(config), "--method", "own"]
        rest = ["--junction", self.site.junction, *self._times(), "--report", str(path)]
        done = subprocess.run([*own, *rest], check=False)
        if done.returncode not in (0, EXIT_COLLIDED):
            raise subprocess.CalledProcessError(done.returncode, done.args)

    def _times(self) -> list[str]:
        return ["--duration", str(self.duration), "--warmup", str(self.warmup), "--seed", str(self.seed)]


def _trip_loss_s(trips: Path, warmup: int) -> float | None:
    """Mean time loss of whole trips, waiting to depart included, of those who departed after the warm-up."""
    losses = [
        float(trip.get("timeLoss", 0.0)) + float(trip.get("departDelay", 0.0))
        for trip in ET.parse(trips).getroot().iter("tripinfo")
        if float(trip.get("depart", 0.0)) >= warmup
    ]
    return statistics.fmean(losses) if losses else None


def capacity(site: Site, out: Path) -> tuple[float, list[tuple[int, float]]]:
    """What the net's own control can serve, veh/h: the most that crossed while demand was raised; every step of it."""
    flow, steps = 120.0 * site.lanes, []
    while True:
        report = Run(site, False, round(flow), 99, 600, 120, out).report()
        vehicles = report["vehicles"]
        steps.append((round(flow), 60.0 * report["throughput_veh_min"]))
        waiting, standing = vehicles["waiting_to_enter"], vehicles["in_zone"]
        if max(waiting / WAITING, standing / STANDING) > vehicles["arrived"]:
            return max(served for _, served in steps), steps
        flow *= STEP


HEADER = (
    "| junction | demand veh/h | of capacity | control | crossed | left waiting | time loss s | worst seed "
    "| largest s | whole trip's loss s | collisions SUMO / geometric | least PET s | hard brakes |\n"
    "| --- | ---: | ---: | --- |" + " ---: |" * 9
)


def row(site: Site, flow: int, share: float, ours: bool, reports: list[dict[str, Any]]) -> str:
    """One line of the table: means over the seeds, extremes where they count."""

    def every(*path: str) -> list[float]:
        return [value for report in reports if (value := _at(report, *path)) is not None]

    loss, safety = every("time_loss_s", "mean"), "safety"
    pets = every(safety, "min_pet_s")
    return (
        f"| {site.name} | {flow:,} | {share:.0%} | {'gameopt' if ours else 'own'} "
        f"| {statistics.fmean(every('vehicles', 'crossed')):.0f} | {max(every('vehicles', 'waiting_to_enter')):.0f} "
        f"| {statistics.fmean(loss):.2f} | {max(loss):.2f} | {max(every('time_loss_s', 'max')):.1f} "
        f"| {statistics.fmean(every('trip_loss_s')):.2f} "
        f"| {sum(every(safety, 'collisions_sumo')):.0f} / {sum(every(safety, 'collisions_geometric')):.0f} "
        f"| {min(pets) if pets else float('nan'):.2f} | {statistics.fmean(every(safety, 'hard_brakes')):.1f} |"
    )


def _at(report: dict[str, Any], *path: str) -> Any:
    value: Any = report
    for name in path:
        value = value[name]
    return value


@click.command(context_settings={"show_default": True})
@click.option("--only", default="", help="Names of junctions, comma-separated; else all.")
@click.option("--seeds", default="101-103", help="FIRST-LAST.")
@click.option("--shares", default="0.5,0.9", help="Demand as shares of the own control's capacity.")
@click.option("--duration", default=360, help="Simulated seconds, warm-up included.")
@click.option("--warmup", default=60, help="Simulated seconds before measuring.")
@click.option("--jobs", default=2, help="Runs at a time.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/any-junction"))
def main(only: str, seeds: str, shares: str, duration: int, warmup: int, jobs: int, out: Path) -> None:
    """Measure every junction and print a Markdown table."""
    first, _, last = seeds.partition("-")
    names = only.split(",") if only else (*SHIPPED, *NAMES)
    chosen = [site(name, out / "nets") for name in names]
    versions = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    click.echo(f"`{' '.join(['python', *sys.argv])}`\n")
    click.echo(f"{datetime.now(UTC):%Y-%m-%d}; Python {platform.python_version()}, {versions}\n")
    with ThreadPoolExecutor(jobs) as pool:
        capacities = list(pool.map(lambda place: capacity(place, out), chosen))
        click.echo(HEADER)
        collided = False
        for place, (most, _) in zip(chosen, capacities, strict=True):
            for share in (float(part) for part in shares.split(",")):
                flow = round(share * most)
                for ours in (False, True):
                    runs = [
                        Run(place, ours, flow, seed, duration, warmup, out)
                        for seed in range(int(first), int(last or first) + 1)
                    ]
                    reports = list(pool.map(Run.report, runs))
                    click.echo(row(place, flow, share, ours, reports))
                    collided |= ours and any(_at(r, "safety", name) for r in reports for name in COLLISIONS)
        click.echo("\nCapacity of the own control, demand raised until it saturates (demand: served, veh/h):\n")
        for place, (most, steps) in zip(chosen, capacities, strict=True):
            click.echo(f"- {place.name}: {most:.0f} ({', '.join(f'{d}: {served:.0f}' for d, served in steps)})")
    sys.exit(collided)


if __name__ == "__main__":
    main()
