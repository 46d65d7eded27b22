"""Control cycles caught between their snapshot and their programs, of several managers that decide the same traffic.

In lock-step the same messages lead to the same commands for any number of workers. So one made-up traffic is decided
by several managers at once, each control cycle by one after the other, and their times are pairs; a further manager,
whose times do not count, is watched for what its programs were made of.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace

from gameopt_im.benchmarks.pairs import Timed, rotated
from gameopt_im.core.budget import Ask
from gameopt_im.core.decision import Winner
from gameopt_im.core.interlock import Limits
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.garbage import BetweenCycles
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_im.solver.contest import Solver
from gameopt_im.solver.horizon_job import HorizonJob
from gameopt_im.solver.jobs import Outcome
from gameopt_im.strategy import Proposal, Strategy
from gameopt_wire.messages import STEP_S, Command, CycleReport

SETTLING_CYCLES = 200
"""Control cycles before the measurement: queues form, compiled code and solver workspaces are there."""
EVERY = 10
"""Control cycles from one that is caught to the next."""
INGEST, PLANNING = "ingest", ("auction", "programs")
"""The stage before a decision, and those of the decision that a profile makes its own way."""


@dataclass(frozen=True, slots=True)
class Caught:
    """What one control cycle's candidates were made of, and the programs of each."""

    snapshot: Snapshot
    book: Book
    limits: Limits
    jobs: Sequence[HorizonJob]


@dataclass(frozen=True, slots=True)
class Moment:
    """A control cycle that was caught, with the service's times for it, s: the decision, and its planning alone."""

    caught: Caught
    decision_s: float
    planning_s: float


@dataclass(frozen=True, slots=True)
class Watched:
    """One traffic: the moments, and how long each number of workers took for every decision."""

    moments: list[Moment]
    decisions: dict[str, list[Timed]]


class _Watch:
    """A strategy that lets another one decide, and keeps what it was given where that is wanted."""

    def __init__(self, inner: Strategy) -> None:
        self.slotless = inner.slotless
        self.wanted = False
        self.caught: Caught | None = None
        self._inner = inner

    def propose(
        self, snapshot: Snapshot, book: Book, limits: Limits, who: Bidders, previous: tuple[str, ...], effort: Ask
    ) -> Proposal:
        """The other one's candidates."""
        kept = copy.deepcopy(book) if self.wanted else None  # grants change it before the control cycle is over
        proposal = self._inner.propose(snapshot, book, limits, who, previous, effort)
        self.caught = None if kept is None else Caught(snapshot, kept, limits, proposal.jobs)
        return proposal

    def choose(self, proposal: Proposal, results: Sequence[Outcome | None]) -> Winner | None:
        """The other one's choice."""
        return self._inner.choose(proposal, results)


class _WatchedManager(Manager):
    """A manager whose strategy is watched."""

    watch: _Watch

    def _fresh_strategy(self) -> Strategy:
        self.watch = _Watch(super()._fresh_strategy())
        return self.watch


async def watch(options: ServeOptions, vehicles: int, workers: Sequence[int], samples: int) -> Watched:
    """`samples` moments of made-up traffic, and the decisions of all control cycles in between by so many workers."""
    moments: list[Moment] = []
    decisions: dict[str, list[Timed]] = {str(count): [] for count in workers}
    traffic = Rehearsal(options.map, vehicles)
    cycles = SETTLING_CYCLES + samples * EVERY
    async with AsyncExitStack() as stack:
        managers: dict[str, Manager] = {}
        for count in workers:
            managers[str(count)] = Manager(options, 1, await _started(stack, options, count))
        # First in every control cycle: the workspaces of this process are as warm for each that is timed after it.
        seen = _WatchedManager(options, 1, await _started(stack, options, 1))
        garbage = stack.enter_context(BetweenCycles())
        for cycle in range(1, cycles + 1):
            time_s = cycle * STEP_S
            messages = traffic.messages(time_s)
            seen.watch.wanted = cycle > SETTLING_CYCLES and cycle % EVERY == 0
            outcome = await seen.control_cycle(cycle, time_s, messages)
            times = {}
            for name in rotated(list(managers), cycle):
                other = await managers[name].control_cycle(cycle, time_s, messages)
                times[name] = other.report
                if cycle > SETTLING_CYCLES:
                    wrong = _differs(outcome.commands, other.commands)
                    decisions[name].append(Timed(1e-3 * decision_ms(other.report), wrong))
            if seen.watch.caught is not None and seen.watch.caught.jobs:
                moments.append(_moment(seen.watch.caught, times[str(options.workers)]))
            traffic.obey(outcome.commands)
            garbage.cycle_done()
    return Watched(moments, decisions)


async def _started(stack: AsyncExitStack, options: ServeOptions, workers: int) -> Solver:
    pool = solver_of(replace(options, workers=workers))
    await stack.enter_async_context(pool)
    return pool


def decision_ms(report: CycleReport) -> float:
    """From snapshot to commands."""
    return sum(took for stage, took in report.stages_ms.items() if stage != INGEST)


def _moment(caught: Caught, report: CycleReport) -> Moment:
    planning_ms = sum(report.stages_ms[stage] for stage in PLANNING)
    return Moment(caught, 1e-3 * decision_ms(report), 1e-3 * planning_ms)


def _differs(commands: list[Command], others: list[Command]) -> str | None:
    return None if commands == others else "other commands"
