"""How long decisions take: the manager's control cycles on made-up or recorded traffic, stage by stage, no network."""

from __future__ import annotations

import itertools
import platform
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
import structlog
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from gameopt_im import recorder
from gameopt_im.benchmarks import growth, moments, pairs, ratios, solvers
from gameopt_im.benchmarks.growth import Growth
from gameopt_im.benchmarks.moments import SETTLING_CYCLES
from gameopt_im.benchmarks.pairs import Ratio
from gameopt_im.garbage import BetweenCycles
from gameopt_im.manager import Manager, Outcome
from gameopt_im.options import ServeOptions, StartError
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.replay import options_of
from gameopt_im.service import solver_of
from gameopt_im.solver.contest import Solver
from gameopt_im.warm_up import warm_up
from gameopt_wire.messages import STEP_S, CycleReport

log = structlog.get_logger()

TURN_CYCLES = 20
"""Control cycles of one number of vehicles before it is the next one's turn."""
REDRAW_CYCLES = 20
"""Control cycles from one look of the progress bar to the next."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
DECISION, WITHOUT = "decision", "without programs"
"""Rows beside the stages: snapshot in, commands out, and the same less the programs."""
SCHEMA = "gameopt-bench/2"
LIBRARIES = ("gameopt", "osqp", "numpy", "numba")


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
    growth: list[Growth]
    """Of the made-up traffic, stage by stage; empty for fewer than three numbers of vehicles."""
    ratios: list[Ratio]


@dataclass(frozen=True, slots=True)
class Bench:
    """What to measure: numbers of vehicles made up, recordings, control cycles of each, and whether to compare."""

    options: ServeOptions
    vehicles: Sequence[int]
    recordings: Sequence[Path]
    cycles: int
    ratios: bool = True


async def run(bench: Bench) -> Results:
    """Measure everything, one after the other."""
    await warm_up(bench.options)
    made_up = await _made_up(bench)
    measured = made_up + [await _recorded(bench, path) for path in bench.recordings]
    compared: list[Ratio] = []
    for count in bench.vehicles if bench.ratios else ():
        log.info("comparing", vehicles=count)
        compared += await ratios.compare(bench.options, count, min(ratios.SAMPLES, bench.cycles))
    return Results(SCHEMA, _versions(), bench.options.workers, measured, _growth(made_up), compared)


def _versions() -> dict[str, str]:
    """Of Python and the libraries; of an optional solver, where it is there."""
    versions = {"python": platform.python_version(), **{name: version(name) for name in LIBRARIES}}
    return versions | {name: found for name in solvers.OPTIONAL if (found := solvers.installed(name)) is not None}


def _growth(made_up: Sequence[Measured]) -> list[Growth]:
    medians = [{stage: figures["p50"] for stage, figures in each.stages_ms.items()} for each in made_up]
    return growth.growths([each.vehicles for each in made_up], [each.uncleared for each in made_up], medians)


async def _made_up(bench: Bench) -> list[Measured]:
    """Control cycles of vehicles that obey.

    Numbers of vehicles take turns of `TURN_CYCLES`: what else the machine does falls on all of them, so that their
    times can be compared.
    """
    total = SETTLING_CYCLES + bench.cycles
    reports: dict[int, list[CycleReport]] = {count: [] for count in bench.vehicles}
    async with solver_of(bench.options) as pool:
        runs = {count: _obeyed(bench.options, count, pool) for count in reports}
        with _unseen(total * len(runs)) as seen:
            while any(len(each) < total for each in reports.values()):
                for count, outcomes in runs.items():
                    for _ in range(min(TURN_CYCLES, total - len(reports[count]))):
                        reports[count].append((await anext(outcomes)).report)
                        seen(f"{count} vehicles")
    return [_measured(f"{count} vehicles", each) for count, each in reports.items()]


async def _obeyed(options: ServeOptions, count: int, pool: Solver) -> AsyncIterator[Outcome]:
    """Control cycles of `count` vehicles that obey, without end."""
    manager, rehearsal = Manager(options, 1, pool), Rehearsal(options.map, count)
    for cycle in itertools.count(1):
        time_s = cycle * STEP_S
        outcome = await manager.control_cycle(cycle, time_s, rehearsal.messages(time_s))
        rehearsal.obey(outcome.commands)
        yield outcome


async def _recorded(bench: Bench, path: Path) -> Measured:
    """The control cycles of a recorded run, decided again."""
    recording = recorder.read(path)
    options = replace(options_of(recording), workers=bench.options.workers)
    reports: list[CycleReport] = []
    async with solver_of(options) as pool:
        # Under another term the vehicles' clearances would be foreign: all of them would be taken for intruders.
        manager = Manager(options, recording.charter.term, pool)
        with _unseen(None) as seen:
            for recorded in recording.cycles():
                tick = recorded.tick
                if tick.restarted:
                    manager.restart()
                reports.append((await manager.control_cycle(tick.cycle, tick.time_s, tick.messages)).report)
                seen(path.name)
    if len(reports) <= SETTLING_CYCLES:
        raise StartError(f"{path.name}: {len(reports)} control cycles; allowed: more than {SETTLING_CYCLES}")
    return _measured(path.name, reports)


@contextmanager
def _unseen(total: int | None) -> Iterator[Callable[[str], None]]:
    """A progress bar, to be told of every control cycle's end.

    Nothing is drawn, and no garbage collected, while a control cycle is timed.
    """
    bar = Progress(console=Console(stderr=True), transient=True, auto_refresh=False)
    with bar as progress, BetweenCycles() as garbage:
        task = progress.add_task("", total=total)
        done = itertools.count(1)

        def seen(what: str) -> None:
            progress.update(task, advance=1, description=what, refresh=next(done) % REDRAW_CYCLES == 0)
            garbage.cycle_done()

        yield seen


def _measured(name: str, reports: Sequence[CycleReport]) -> Measured:
    """The figures of all but the first `SETTLING_CYCLES`."""
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
    decision = np.array([moments.decision_ms(report) for report in reports])
    times |= {DECISION: decision, WITHOUT: decision - times["programs"]}
    return {
        stage: {name: round(float(np.percentile(each, share)), 3) for name, share in PERCENTILES.items()}
        for stage, each in times.items()
    }


def tables(results: Results) -> Iterator[Table]:
    """The results to read."""
    yield _stage_table(results)
    if results.growth:
        yield growth.table(results.growth)
    if results.ratios:
        yield pairs.table(results.ratios)


def _stage_table(results: Results) -> Table:
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
