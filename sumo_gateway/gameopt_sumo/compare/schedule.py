"""All runs of a comparison: what is missing is run, several at a time, with the time left; Ctrl-C ends it cleanly."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from gameopt_sumo.compare import plans
from gameopt_sumo.compare.methods import named
from gameopt_sumo.compare.plans import Tuning
from gameopt_sumo.compare.processes import Processes, Stopped
from gameopt_sumo.compare.runs import FAILED, RUN, Failure, Place, Run, perform
from gameopt_sumo.files import write_whole

Work = Callable[[Processes], None]

BY_SUMO_SHARE = 0.15
"""What a run under SUMO's own control takes, of what one under our manager takes."""


def carry_out(place: Place, runs: Sequence[Run], jobs: int, processes: Processes, console: Console) -> int:
    """Run whatever has no whole report yet; how many that was. Raises `Stopped` once all has ended."""
    todo = [run for run in runs if not place.done(run)]
    for run in todo:
        processes.check()
        place.make_scenario(run)
    tunings = sorted({plans.needed(run, method) for run in todo if (method := named(run.method)).plan})
    wrong = _tune(place, tunings, jobs, processes, console)
    ready = [run for run in todo if not _spoiled(run, place, wrong)]
    _together(
        "runs", [(_cost(run), partial(perform, run, place, jobs=jobs)) for run in ready], jobs, processes, console
    )
    return len(todo)


def _tune(
    place: Place, tunings: Sequence[Tuning], jobs: int, processes: Processes, console: Console
) -> dict[Tuning, str]:
    """Tune lights, one search after the other; what went wrong with those that failed."""
    wrong: dict[Tuning, str] = {}

    def search(tuning: Tuning, processes: Processes) -> None:
        # A trial is one process, where one of our runs is two.
        if (reason := plans.tune(place.out, tuning, place.settings, 2 * jobs, processes)) is not None:
            wrong[tuning] = reason

    _together("tuning lights", [(1.0, partial(search, tuning)) for tuning in tunings], 1, processes, console)
    return wrong


def _spoiled(run: Run, place: Place, wrong: dict[Tuning, str]) -> bool:
    """Whether the run's lights could not be tuned; then it is on record as failed."""
    method = named(run.method)
    reason = wrong.get(plans.needed(run, method)) if method.plan else None
    if reason is None:
        return False
    folder = place.folder(run)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / RUN, msgspec.json.encode(run))
    write_whole(folder / FAILED, msgspec.json.encode(Failure(f"its lights could not be tuned: {reason}")))
    return True


def _cost(run: Run) -> float:
    """How long it takes beside the others: the bar's idea of the time left rests on it."""
    busy = 1.0 + (run.flow_veh_h or 4000.0) / 2000.0
    return busy if named(run.method).ours else BY_SUMO_SHARE * busy


def _together(what: str, work: Sequence[tuple[float, Work]], jobs: int, processes: Processes, console: Console) -> None:
    """Do all of it, `jobs` at a time. Whatever one of them raises ends the others, and is raised."""
    columns = (
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(elapsed_when_finished=False),
    )
    total = sum(cost for cost, _ in work)
    with ThreadPoolExecutor(jobs) as pool, Progress(*columns, console=console, disable=not work) as bar:
        task = bar.add_task(what, total=len(work))
        scale = len(work) / total if total else 1.0
        costs: dict[Future[None], float] = {}
        try:
            for cost, do in work:
                costs[pool.submit(_unless_stopped, do, processes)] = cost * scale
            for future in _as_completed(costs):
                future.result()
                bar.advance(task, costs[future])
            bar.update(task, completed=len(work))  # the costs add up to that but for rounding
        except BaseException:
            processes.stop()
            pool.shutdown(cancel_futures=True)
            raise


def _unless_stopped(do: Work, processes: Processes) -> None:
    processes.check()
    do(processes)


def _as_completed(futures: dict[Future[None], float]) -> Iterator[Future[None]]:
    left = set(futures)
    while left:
        done, left = wait(left, return_when=FIRST_COMPLETED)
        yield from done


@contextmanager
def interruptible(processes: Processes) -> Iterator[None]:
    """SIGINT and SIGTERM stop all processes, and once they have ended raise `KeyboardInterrupt`.

    Nothing is raised out of a signal's handler: it could come between a thread's start and its entry in the pool.
    """
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda _number, _frame: processes.stop())
    try:
        yield
        processes.check()
    except Stopped:
        raise KeyboardInterrupt from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
