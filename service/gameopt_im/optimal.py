"""How near the auction and its programs come to the optimum, and how much sooner: both on the same recorded states.

    python -m gameopt_im.optimal RECORDING.mcap --sizes 4,6,8,10 --states 20 --limit 60 --json optimal.json

The same command goes on from what `optimal.json` has.

The optimum is that of the paper's one-step program over all orders that keep the lanes (`core/joint.py`), found by
SCIP. Against it stand the paper's K sequences and their programs, as the profile `paper` runs them. Objectives are
evaluated alike, on full lateral rows, for the order that either came to. Times are processor times of one core, from
the state to the order and its speeds, the making of the problem included. Only the vehicles' columns, which either
problem is made of, are made once, and count for the auction.
"""

from __future__ import annotations

import asyncio
import hashlib
import platform
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Any

import click
import msgspec
import numpy as np
from rich.console import Console
from rich.progress import Progress

from gameopt_im import logs, recorder
from gameopt_im.core import interlock, planning
from gameopt_im.core.budget import Effort
from gameopt_im.core.conflicts import Ground, ground
from gameopt_im.core.joint import in_order, joint
from gameopt_im.core.reservations import Book
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import NONE, Ints, Snapshot
from gameopt_im.optimal_results import SCHEMA, Compared, Results, Size, kept, table, write
from gameopt_im.options import ServeOptions, StartError
from gameopt_im.recorder import Recording
from gameopt_im.replay import options_of
from gameopt_im.solver.jobs import PaperJob
from gameopt_im.solver.workspace import kept_workspace, pattern
from gameopt_im.strategy import PaperProfile
from gameopt_im.tracker import Tracker
from gameopt_im.warm_up import warm_up
from gameopt_wire.messages import STEP_S

MOST_VEHICLES = 64
GIVEN_UP = 3
"""A size is left, and is the last one, when so many of its states have reached the limit."""
LATERAL_ROWS = ("reduced", "full")
LIBRARIES = ("gameopt", "osqp", "numpy", "numba", "pyscipopt")


def _sizes(_context: click.Context, _option: click.Parameter, text: str) -> tuple[int, ...]:
    """Numbers of vehicles, separated by commas."""
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = ()
    if not sizes or min(sizes) < 2 or max(sizes) > MOST_VEHICLES:
        raise click.BadParameter(f"{text!r}; allowed: whole numbers from 2 to {MOST_VEHICLES}, separated by commas")
    return sizes


def compare(
    path: Path, sizes: Sequence[int], states: int, limit_s: float, json_file: Path | None = None
) -> Iterator[Results]:
    """Compare on up to `states` states of each size, small sizes first; all so far after each, and why it ended.

    Goes on from the results in `json_file`, if they are there. Raises `StartError`, also for results of anything else.
    """
    _require_scip()
    recording = recorder.read(path)
    options = replace(options_of(recording), profile="paper", geometry="box")
    known = ground(options.map, "box", options.parameters.program.lateral_margin_m, options.turn_speed)
    results = Results(SCHEMA, _versions(), path.name, _digest(path), options.candidates, states, limit_s, [])
    done = {size.vehicles: size for size in kept(json_file, results)}
    asyncio.run(warm_up(options))  # compiles what is measured
    snapshots = list(_uncleared(recording, known))

    def so_far(ended: str | None = None) -> Results:
        return msgspec.structs.replace(results, sizes=[done[n] for n in sorted(done)], ended=ended)

    with Progress(console=Console(stderr=True), transient=True) as progress:
        for n in sorted({*sizes, *done}):
            if n not in done:
                chosen = _spread([each for each in snapshots if len(each) >= n], states)
                if not chosen:
                    never = f"never {n} vehicles without a clearance at a time"
                    if not done:
                        raise StartError(f"{path}: {never}; allowed: busier traffic")
                    yield so_far(never)
                    return
                tracked = progress.track(chosen, description=f"{n} vehicles")
                done[n] = Size(n, _until_given_up(tracked, n, options, known, limit_s))
                yield so_far()
            if (unsolved := sum(not each.solved for each in done[n].states)) > 0:
                yield so_far(f"{unsolved} of {len(done[n].states)} states of {n} vehicles not solved in {limit_s:g} s")
                return
    yield so_far("no more were asked for")


def _until_given_up(
    snapshots: Iterable[Snapshot], n: int, options: ServeOptions, known: Ground, limit_s: float
) -> list[Compared]:
    """Both methods on the n nearest vehicles of each state, until so many have reached the limit."""
    compared: list[Compared] = []
    for snapshot in snapshots:
        compared.append(_compared(_nearest(snapshot, n), options, known, limit_s))
        if sum(not each.solved for each in compared) >= GIVEN_UP:
            break
    return compared


def _digest(path: Path) -> str:
    with path.open("rb") as recording:
        return hashlib.file_digest(recording, "sha256").hexdigest()


def _require_scip() -> None:
    try:
        import pyscipopt  # noqa: F401
    except ImportError:
        raise StartError("needs SCIP; allowed after: pip install 'gameopt[optimal]'") from None


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version(), **{name: version(name) for name in LIBRARIES}}
    from pyscipopt import Model

    return versions | {"scip": str(Model().version())}


def _uncleared(recording: Recording, known: Ground) -> Iterator[Snapshot]:
    """The vehicles without a clearance, as they were heard in each control cycle: who could stop, and says it has none.

    Nothing is decided again: the states are those that the recorded run led to.
    """
    options = options_of(recording)
    tracker = Tracker(options.map, known, options.parameters, options.clock, recording.charter.term)
    for recorded in recording.cycles():
        tick = recorded.tick
        if tick.restarted:
            tracker.reset()
        tracker.ingest(tick.messages, tick.time_s)
        snapshot = tracker.snapshot(tick.cycle, tick.time_s, ())
        phase = interlock.phases(snapshot, known, Book())
        free = (phase == interlock.UNCLEARED) & (snapshot.accepted == NONE) & ~snapshot.silent
        yield _part(snapshot, np.flatnonzero(free))


def _part(snapshot: Snapshot, members: Ints) -> Snapshot:
    """The snapshot of some of its vehicles."""
    columns = {name: getattr(snapshot, name) for name in Snapshot.__dataclass_fields__}
    arrays: dict[str, Any] = {name: each[members] for name, each in columns.items() if isinstance(each, np.ndarray)}
    return replace(snapshot, ids=tuple(snapshot.ids[i] for i in members), **arrays)


def _nearest(snapshot: Snapshot, n: int) -> Snapshot:
    """The n vehicles nearest the line, still in order of zone entry."""
    return _part(snapshot, np.sort(np.argsort(snapshot.s, kind="stable")[:n]))


def _spread(snapshots: Sequence[Snapshot], count: int) -> list[Snapshot]:
    """At most `count` of them, evenly over the time they cover."""
    if len(snapshots) <= count:
        return list(snapshots)
    return [snapshots[round(k * (len(snapshots) - 1) / max(count - 1, 1))] for k in range(count)]


def _compared(snapshot: Snapshot, options: ServeOptions, known: Ground, limit_s: float) -> Compared:
    """Both methods on one state."""
    from gameopt_im.solver.joint_order import solve

    (auction_s, chosen), (full_rows_s, by_full) = (_auctioned(snapshot, options, known, rows) for rows in LATERAL_ROWS)
    vehicles = chosen.vehicles
    started = process_time()
    problem = joint(vehicles, known.conflict, options.parameters.program, STEP_S)
    making_s = process_time() - started
    answer = solve(problem, limit_s)
    return Compared(
        time_s=snapshot.time_s,
        orders_open=int(np.triu(problem.free).sum()),
        solved=answer.optimal,
        optimal_s=making_s + answer.seconds,
        optimal=None if answer.order is None else _reached(replace(chosen, order=answer.order)),
        bound=answer.bound,
        auction_s=auction_s,
        auction=_reached(chosen),
        full_rows_s=full_rows_s,
        full_rows=_reached(by_full),
    )


def _auctioned(snapshot: Snapshot, options: ServeOptions, known: Ground, rows: str) -> tuple[float, PaperJob]:
    """(s, the winner's job) of the profile `paper` on these vehicles: bids, sequences, programs, least J."""
    settings = msgspec.structs.replace(options.parameters.program, lateral_rows=rows)
    parameters = msgspec.structs.replace(options.parameters, program=settings)
    paper = PaperProfile(replace(options, parameters=parameters), known)
    limits = interlock.limits(snapshot, known, Book(), parameters.exit)
    started = process_time()
    who = planning.bidders(snapshot, known, Book(), limits, parameters, options.candidates)
    proposal = paper.propose(snapshot, Book(), limits, who, (), lambda: Effort(options.candidates))
    winner = paper.choose(proposal, [job.solve() for job in proposal.jobs])
    seconds = process_time() - started
    assert winner is not None
    job: PaperJob = proposal.jobs[winner.number]
    return seconds, job


def _reached(job: PaperJob) -> float:
    """The least objective of a job's order on full lateral rows, far more exactly than a control cycle asks for."""
    qp = in_order(job.vehicles, job.order, job.conflict, job.parameters, STEP_S)
    solution = kept_workspace(residual_mps=1e-5, max_iter=200_000).solve(pattern(qp), qp)
    if solution is None:
        raise StartError("a program without a solution within 200,000 iterations")
    return objective(qp, solution.x)


@click.command(context_settings={"show_default": True})
@click.argument("recording", type=click.Path(path_type=Path, dir_okay=False), metavar="RECORDING.mcap")
@click.option(
    "--sizes",
    default="4,6,8,10,12,14,16,20,24,28,32,36,40,44,48,52,56,60,64",
    metavar="N,N,...",
    callback=_sizes,
    help="Numbers of vehicles.",
)
@click.option("--states", type=click.IntRange(1, 1000), default=20, help="States of each size, over the whole run.")
@click.option(
    "--limit", "limit_s", type=click.FloatRange(0.1, 3600.0), default=60.0, help="Processor time for an optimum, s."
)
@click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    show_default=False,
    help="Write every state here, after each size; what it has already is gone on from.",
)
def command(*, recording: Path, sizes: tuple[int, ...], states: int, limit_s: float, json_file: Path | None) -> None:
    """Compare the auction and its programs with the optimum over all orders, on recorded states.

    Sizes are gone through from small to large, up to the first with a state that is not solved within the limit.
    """
    results = None
    for results in compare(recording, sizes, states, limit_s, json_file):
        if json_file is not None:
            write(json_file, results)  # a size may take an hour: what is there is kept
    if results is not None:
        Console().print(table(results))
        click.echo(f"More vehicles were not tried: {results.ended}.")


def run(arguments: Sequence[str]) -> int:
    """Runs one command line; its exit code."""
    logs.configure("text")
    try:
        command.main(list(arguments), "gameopt_im.optimal", standalone_mode=False)
    except (click.ClickException, StartError) as error:
        why = error.format_message() if isinstance(error, click.ClickException) else str(error)
        click.echo(f"gameopt_im.optimal: {' '.join(why.split())}", err=True)
        return 2
    except click.Abort:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
