"""The live service under load: manager and vehicles as processes over Zenoh, by the wall clock, against the targets.

    python tests/load/live.py --load 60:180 --load 130:180 --load 260:600 --workers 1 --out out/load

Each load is so many synthetic vehicles for so many seconds after the warm-up. Leaves `load.json`, `load.md` and the
vehicles' reports in the output folder. Ends with exit 1 if a control cycle was missed.
"""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
import msgspec
import psutil
from beside import Beside
from control_cycles import AtSpeed, ControlCycles
from machine import FixedWork, cores

from gameopt_sumo.compare.processes import ProcessError, Processes

SAMPLE_S, SHORTEST_S = 0.5, 10
MB = 2**20
WAY_P99_MS = {60: 5.0, 130: 10.0, 260: 25.0}
"""The target for the whole way by number of vehicles; the others hold at the largest."""
LARGEST = max(WAY_P99_MS)
WAY_MAX_MS, TRIP_P99_MS, CPU_PERCENT, GROWTH_MB = 60.0, 40.0, 60.0, 5.0
UNANSWERED_PERCENT = 1.0
"""Of states, without a command before the next one: they are in no time of the round trip, so they must be few."""


def unanswered_percent(trip: dict[str, Any]) -> float:
    """The share of states that had no command before the next one."""
    return 100.0 * float(trip["unanswered"]) / max(1, trip["count"] + trip["unanswered"])


@dataclass(frozen=True)
class Load:
    """So many vehicles for so long."""

    vehicles: int
    seconds: int

    @classmethod
    def parse(cls, text: str) -> Load:
        """From `VEHICLES:SECONDS`."""
        vehicles, _, seconds = text.partition(":")
        if not (vehicles.isdecimal() and seconds.isdecimal() and int(vehicles) and int(seconds) >= SHORTEST_S):
            raise click.BadParameter(f"{text!r}; allowed: VEHICLES:SECONDS, from {SHORTEST_S} s, as in 260:600")
        return cls(int(vehicles), int(seconds))


@dataclass(frozen=True)
class Sample:
    """Processor time used so far, s, and memory resident, bytes, of the manager and its workers, and the vehicles."""

    at_s: float
    manager_s: float
    workers_s: float
    vehicles_s: float
    resident: int


@dataclass
class Watch(Beside):
    """Looks at the processes that this one has started."""

    samples: list[Sample] = field(default_factory=list)
    every_s: float = SAMPLE_S

    def look(self) -> None:
        """What they have used so far, while there are both manager and vehicles."""
        with suppress(psutil.NoSuchProcess):  # it ended while it was looked at
            self._sample()

    def _sample(self) -> None:
        named = {name: child for child in psutil.Process().children() if (name := _command(child))}
        if len(named) < 2:
            return
        manager, vehicles = named["gameopt-im"], named["gameopt-vehicles"]
        workers = manager.children(recursive=True)
        resident = sum(each.memory_info().rss for each in [manager, *workers])
        spent = [sum(map(_processor_s, each)) for each in ([manager], workers, [vehicles])]
        self.samples.append(Sample(time.monotonic(), *spent, resident))

    def measured(self, warmup_s: int) -> tuple[float, float]:
        """From when to when both have been there, the warm-up left out, s."""
        return self.samples[0].at_s + warmup_s, self.samples[-1].at_s

    def figures(self, warmup_s: int) -> dict[str, float]:
        """Shares of one core, %, memory, and by how much it grew: its median in the last tenth over the first."""
        began_s, _ = self.measured(warmup_s)
        kept = [sample for sample in self.samples if sample.at_s >= began_s]
        first, last = kept[0], kept[-1]
        over_s = last.at_s - first.at_s
        tenth = max(1, len(kept) // 10)
        resident = [statistics.median(each.resident for each in part) / MB for part in (kept[:tenth], kept[-tenth:])]
        return {
            "manager_percent": round(100.0 * (last.manager_s - first.manager_s) / over_s, 1),
            "workers_percent": round(100.0 * (last.workers_s - first.workers_s) / over_s, 1),
            "vehicles_percent": round(100.0 * (last.vehicles_s - first.vehicles_s) / over_s, 1),
            "resident_mb": round(resident[1], 1),
            "growth_mb": round(resident[1] - resident[0], 2),
        }


def _command(process: psutil.Process) -> str | None:
    """Which of the two commands a process is."""
    words = {Path(word).name for word in process.cmdline()[:2]}
    return next((name for name in ("gameopt-im", "gameopt-vehicles") if name in words), None)


def _processor_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


@dataclass(frozen=True)
class Line:
    """A figure, and what it has to be."""

    name: str
    value: float | None
    unit: str = ""
    most: float | None = None

    def row(self) -> str:
        """As a row of the table."""
        value = "-" if self.value is None else f"{self.value:g}{self.unit}"
        target = "" if self.most is None else f"<= {self.most:g}{self.unit}"
        held = "" if self.most is None else "yes" if self.value is not None and self.value <= self.most else "**no**"
        return f"| {self.name} | {value} | {target} | {held} |"


@dataclass(frozen=True)
class Measured:
    """One load under one number of workers: the vehicles' report, what the processes used, and what was never slow."""

    load: Load
    workers: int
    report: dict[str, Any]
    used: dict[str, float]
    at_speed: AtSpeed

    @property
    def missed(self) -> int:
        """Control cycles that never began."""
        return int(self.report["control_cycle"]["missed"])

    def lines(self) -> list[Line]:
        """Figures beside the targets; those for one number of vehicles hold for fewer, too."""
        report, used = self.report, self.used
        way, trip = report["whole_way"], report["round_trip"]
        whole, late = way["whole"] or {}, way["late"] or {}
        number, at_speed = self.load.vehicles, self.at_speed
        fast = {} if at_speed.whole is None else msgspec.structs.asdict(at_speed.whole)
        way_ms = next((most for count, most in sorted(WAY_P99_MS.items()) if number <= count), None)
        held = number <= LARGEST
        return [
            Line("vehicles the manager had to do with, mean", way["vehicles"]),
            Line("crossed, a minute", round(report["throughput_veh_min"], 1)),
            Line("control cycles", report["control_cycle"]["count"]),
            Line("control cycles missed", self.missed, "", 0),
            Line("whole way, p50", whole.get("p50_ms"), " ms"),
            Line("whole way, p99", whole.get("p99_ms"), " ms", way_ms),
            Line("whole way, p99.9", whole.get("p999_ms"), " ms"),
            Line("whole way, max", whole.get("max_ms"), " ms", WAY_MAX_MS if held else None),
            Line("begun late by, p99", late.get("p99_ms"), " ms"),
            Line("round trip, p50", trip["p50_ms"], " ms"),
            Line("round trip, p99", trip["p99_ms"], " ms", TRIP_P99_MS if held else None),
            Line("round trip, max", trip["max_ms"], " ms"),
            Line("states unanswered", round(unanswered_percent(trip), 2), " %", UNANSWERED_PERCENT if held else None),
            Line("commands lost", way["commands_lost"]),
            Line("fallbacks", report["fallbacks"]),
            Line("steps the vehicles were late for", report["late_steps"]),
            Line("programs too late", report["qp"]["late"]),
            Line(
                "manager and workers, of one core",
                round(used["manager_percent"] + used["workers_percent"], 1),
                " %",
                CPU_PERCENT if held else None,
            ),
            Line("of that the workers", used["workers_percent"], " %"),
            Line("vehicles, of one core", used["vehicles_percent"], " %"),
            Line("memory of manager and workers", used["resident_mb"], " MB"),
            Line("memory growth", used["growth_mb"], " MB", GROWTH_MB),
            Line("a core slow, of the time", at_speed.slow_percent, " %"),
            Line("control cycles in which none was", at_speed.share_percent, " %"),
            Line("whole way of those, p50", fast.get("p50_ms"), " ms"),
            Line("whole way of those, p99", fast.get("p99_ms"), " ms"),
            Line("whole way of those, max", fast.get("max_ms"), " ms"),
        ]

    def markdown(self) -> str:
        """Both tables: against the targets, and by stage."""
        head = f"## {self.load.vehicles} vehicles, {self.load.seconds} s, workers {self.workers}"
        figures = ["| figure | measured | target | held |", "| --- | ---: | ---: | --- |"]
        figures += [line.row() for line in self.lines()]
        stages = ["| stage, ms | p50 | p99 | p99.9 | max |", "| --- | ---: | ---: | ---: | ---: |"]
        for stage, spread in self.report["whole_way"]["stages"].items():
            stages.append(f"| {stage} | " + " | ".join(f"{value:g}" for value in spread.values()) + " |")
        return "\n".join([head, "", *figures, "", *stages, ""])


def measure(load: Load, workers: int, options: list[str], warmup_s: int, out: Path) -> Measured:
    """Manager and vehicles from start to end. Raises `ProcessError`."""
    folder = out / f"{load.vehicles}-{load.seconds}-{workers}"
    folder.mkdir(parents=True, exist_ok=True)
    report = folder / "report.json"
    report.unlink(missing_ok=True)
    serve = ["--clock", "wall", "--workers", str(workers), *options]
    length = ["--duration", str(warmup_s + load.seconds), "--warmup", str(warmup_s)]
    drive = ["--clock", "wall", "--synthetic", str(load.vehicles), *length, "--report", str(report)]
    processes = Processes()
    with ExitStack() as beside:
        watch = beside.enter_context(Watch())
        manager = beside.enter_context(processes.serving(serve, folder))
        cycles = beside.enter_context(ControlCycles(manager.endpoint))
        noise = [beside.enter_context(FixedWork(core)) for core in cores()]
        code = processes.drive(manager.endpoint, drive, folder)
    if code != 0 or not report.exists():
        raise ProcessError(f"the vehicles ended with exit code {code}; see {folder}")
    at_speed = cycles.at_speed(noise, *watch.measured(warmup_s))
    return Measured(load, workers, json.loads(report.read_text()), watch.figures(warmup_s), at_speed)


def written(measured: list[Measured], out: Path) -> str:
    """The results so far as Markdown, which is left in the output folder together with all figures."""
    where = f"{datetime.now(UTC):%Y-%m-%d}; python {platform.python_version()}, {psutil.cpu_count()} cores"
    text = "\n".join([f"# The live service under load\n\n{where}.\n", *(each.markdown() for each in measured)])
    (out / "load.md").write_text(text)
    (out / "load.json").write_bytes(msgspec.json.format(msgspec.json.encode(measured)) + b"\n")
    return text


@click.command(context_settings={"show_default": True})
@click.option("--load", "loads", multiple=True, default=("60:180", "130:180", "260:600"), metavar="VEHICLES:SECONDS")
@click.option("--workers", default="1", help="Solver processes; several numbers are measured one after the other.")
@click.option("--config", type=click.Path(exists=True, path_type=Path), help="Parameters of the manager.")
@click.option("--candidates", default=8, help="K.")
@click.option("--warmup", default=30, help="Before each load, s: queues form, the first cross; not measured.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/load"))
def main(loads: tuple[str, ...], workers: str, config: Path | None, candidates: int, warmup: int, out: Path) -> None:
    """Run every load, and print the figures beside the targets."""
    options = ["--candidates", str(candidates), *(["--config", str(config)] if config else [])]
    chosen = [Load.parse(load) for load in loads]
    if not all(number.isdecimal() for number in workers.split(",")):
        raise click.BadParameter(f"--workers {workers!r}; allowed: numbers with commas between, as in 1,2")
    out.mkdir(parents=True, exist_ok=True)
    measured: list[Measured] = []
    try:
        for number in map(int, workers.split(",")):
            for load in chosen:
                measured.append(measure(load, number, options, warmup, out))
                print(measured[-1].markdown(), flush=True)  # noqa: T201 - what it is for
                written(measured, out)
    except ProcessError as error:
        raise click.ClickException(str(error)) from None
    sys.exit(1 if any(each.missed for each in measured) else 0)


if __name__ == "__main__":
    main()
