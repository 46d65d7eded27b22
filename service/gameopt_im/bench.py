"""How long decisions take: the manager's control cycles on made-up or recorded traffic, stage by stage, no network."""

from __future__ import annotations

import platform
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from gameopt_im import recorder
from gameopt_im.garbage import BetweenCycles
from gameopt_im.manager import Manager, Outcome
from gameopt_im.options import ServeOptions, StartError
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.replay import options_of
from gameopt_im.service import solver_of
from gameopt_im.warm_up import warm_up
from gameopt_wire.messages import STEP_S, CycleReport

SETTLING_CYCLES = 200
"""Control cycles before the measurement: queues form, compiled code and solver workspaces are there."""
REDRAW_CYCLES = 20
"""Control cycles from one look of the progress bar to the next."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
DECISION, WITHOUT = "decision", "without programs"
"""Rows beside the stages: snapshot in, commands out, and the same less the programs."""
LIBRARIES = ("gameopt", "osqp", "numpy", "numba")


Outcomes = Callable[[Manager], AsyncIterator[Outcome]]
"""Drives a manager through its control cycles."""


class Measured(msgspec.Struct, frozen=True):
    """One kind of traffic: `stages_ms` by stage, and percentile; the last two are `DECISION` and `WITHOUT`."""

    traffic: str
    vehicles: float
    uncleared: float
    cycles: int
    candidates: float
    stages_ms: dict[str, dict[str, float]]


class Results(msgspec.Struct, frozen=True):
    """What `--json` writes."""

    schema: str
    versions: dict[str, str]
    workers: int
    measured: list[Measured]


@dataclass(frozen=True, slots=True)
class Bench:
    """What to measure: numbers of vehicles made up, recordings, and control cycles of each."""

    options: ServeOptions
    vehicles: Sequence[int]
    recordings: Sequence[Path]
    cycles: int


async def run(bench: Bench) -> Results:
    """Measure everything, one after the other."""
    await warm_up(bench.options)
    measured = [await _made_up(bench, count) for count in bench.vehicles]
    measured += [await _recorded(bench, path) for path in bench.recordings]
    versions = {"python": platform.python_version(), **{name: version(name) for name in LIBRARIES}}
    return Results("gameopt-bench/1", versions, bench.options.workers, measured)


async def _made_up(bench: Bench, count: int) -> Measured:
    """Control cycles of `count` vehicles that obey."""
    rehearsal = Rehearsal(bench.options.map, count)

    async def outcomes(manager: Manager) -> AsyncIterator[Outcome]:
        for cycle in range(1, SETTLING_CYCLES + bench.cycles + 1):
            time_s = cycle * STEP_S
            outcome = await manager.control_cycle(cycle, time_s, rehearsal.messages(time_s))
            rehearsal.obey(outcome.commands)
            yield outcome

    return await _measured(f"{count} vehicles", bench.options, outcomes, bench.cycles)


async def _recorded(bench: Bench, path: Path) -> Measured:
    """The control cycles of a recorded run, decided again."""
    recording = recorder.read(path)
    options = replace(options_of(recording), workers=bench.options.workers)

    async def outcomes(manager: Manager) -> AsyncIterator[Outcome]:
        for recorded in recording.cycles():
            tick = recorded.tick
            if tick.restarted:
                manager.restart()
            yield await manager.control_cycle(tick.cycle, tick.time_s, tick.messages)

    return await _measured(path.name, options, outcomes, None)


async def _measured(name: str, options: ServeOptions, outcomes: Outcomes, cycles: int | None) -> Measured:
    reports: list[CycleReport] = []
    total = SETTLING_CYCLES + cycles if cycles else None
    async with solver_of(options) as pool:
        # Nothing is drawn, and no garbage collected, while a control cycle is timed.
        bar = Progress(console=Console(stderr=True), transient=True, auto_refresh=False)
        with bar as progress, BetweenCycles() as garbage:
            task = progress.add_task(name, total=total)
            async for outcome in outcomes(Manager(options, 1, pool)):
                reports.append(outcome.report)
                progress.update(task, advance=1, refresh=len(reports) % REDRAW_CYCLES == 0)
                garbage.cycle_done()
    if len(reports) <= SETTLING_CYCLES:
        raise StartError(f"{name}: {len(reports)} control cycles; allowed: more than {SETTLING_CYCLES}")
    reports = reports[SETTLING_CYCLES:]
    return Measured(
        traffic=name,
        vehicles=float(np.median([report.vehicles for report in reports])),
        uncleared=float(np.median([report.uncleared for report in reports])),
        cycles=len(reports),
        candidates=float(np.median([report.candidates for report in reports])),
        stages_ms=_stages(reports),
    )


def _stages(reports: Sequence[CycleReport]) -> dict[str, dict[str, float]]:
    """Percentiles of every stage, and of what they come to between snapshot and commands."""
    times = {stage: np.array([report.stages_ms[stage] for report in reports]) for stage in reports[-1].stages_ms}
    decision = np.sum([each for stage, each in times.items() if stage != "ingest"], axis=0)
    times |= {DECISION: decision, WITHOUT: decision - times["programs"]}
    return {
        stage: {name: round(float(np.percentile(each, share)), 3) for name, share in PERCENTILES.items()}
        for stage, each in times.items()
    }


def table(results: Results) -> Table:
    """The results to read, a line a stage."""
    shown = Table(title=f"ms a control cycle, {results.workers} solver workers")
    shown.add_column("traffic")
    shown.add_column("stage")
    for name in PERCENTILES:
        shown.add_column(name, justify="right")
    for each in results.measured:
        title = f"{each.traffic}, {each.uncleared:.0f} of {each.vehicles:.0f} uncleared"
        for stage, figures in each.stages_ms.items():
            shown.add_row(title, stage, *(f"{figures[name]:.2f}" for name in PERCENTILES))
            title = ""
        shown.add_section()
    return shown
