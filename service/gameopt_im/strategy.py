"""The profiles: how candidates are proposed, which programs they need, and how q* is chosen.

`DefaultProfile` is the planner that works in a closed loop: dispatch auction, slots, incumbent, horizon program.
`PaperProfile` is the paper taken literally: auction, one-step program, least J.
`StopSign` has neither bids nor slots: the default profile with `interlock.ask = "standing"`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from gameopt_im.core import auction, corridor, decision, planning, program, standing
from gameopt_im.core.budget import Ask
from gameopt_im.core.conflicts import Ground
from gameopt_im.core.decision import Winner
from gameopt_im.core.horizon import carried_over
from gameopt_im.core.interlock import UNCLEARED, Limits
from gameopt_im.core.planning import Bidders, Candidate
from gameopt_im.core.reservations import Book
from gameopt_im.core.slots import Demand
from gameopt_im.core.snapshot import Floats, Ints, Snapshot
from gameopt_im.options import ServeOptions
from gameopt_im.solver.horizon_job import HorizonJob, HorizonOutcome
from gameopt_im.solver.jobs import Outcome, PaperJob
from gameopt_wire.messages import STEP_S

FORGET_CYCLES = 10
"""Control cycles after which a solution is no start for another."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Candidates of a control cycle and the jobs that solve their programs, in the same order."""

    who: Bidders
    candidates: Sequence[Any]
    jobs: Sequence[Any]
    problem: Demand | None
    cycle: int = 0
    vehicles: tuple[str, ...] = ()
    """The bidders, where a later control cycle will ask for them."""

    @property
    def count(self) -> int:
        """How many distinct candidates there are."""
        return len(self.candidates)


class Strategy(Protocol):
    """A profile; `slotless` ones do not say when a vehicle is to cross, only after whom."""

    slotless: bool

    def propose(
        self,
        snapshot: Snapshot,
        book: Book,
        limits: Limits,
        who: Bidders,
        previous: tuple[str, ...],
        effort: Ask,
    ) -> Proposal:
        """The candidates and their programs: of `effort`, asked for once what all candidates share is worked out."""

    def choose(self, proposal: Proposal, results: Sequence[Outcome | None]) -> Winner | None:
        """q* and its speeds; None where there is nobody to plan."""


class Ended(NamedTuple):
    """The multipliers of the winner's program in a control cycle, and the row of each vehicle there."""

    cycle: int
    row: dict[str, int]
    duals: Floats


class DefaultProfile:
    """Dispatch auction, slots, incumbent, approach, horizon program."""

    slotless = False

    def __init__(self, options: ServeOptions, ground: Ground) -> None:
        self._ground = ground
        self._parameters = options.parameters
        self._rules = planning.horizon_rules(options.parameters)
        self._ended: Ended | None = None

    def propose(
        self,
        snapshot: Snapshot,
        book: Book,
        limits: Limits,
        who: Bidders,
        previous: tuple[str, ...],
        effort: Ask,
    ) -> Proposal:
        """The incumbent and up to K dispatch sequences, each with its horizon program."""
        if not len(who):
            return Proposal(who, (), (), None)
        parameters = self._parameters
        stack = book.stack(snapshot.cycle)
        problem = planning.demand(snapshot, self._ground, book, stack, limits, who, parameters)
        incumbent = decision.incumbent_order(previous, snapshot, who)
        priority = snapshot.speed_priority[who.index]
        waited, trying = snapshot.waited[who.index], effort()
        tried = who.tried(trying.candidates)
        options = planning.candidates(problem, tried, priority, waited, incumbent, parameters)
        if not (parameters.program.solve and trying.programs):
            return Proposal(who, options, (), problem)
        task = planning.horizon_task(snapshot, book, limits, problem, who, parameters)
        residual = parameters.program.residual_mps
        vehicles = tuple(snapshot.ids[i] for i in who.index)
        guess = self._guess(snapshot.cycle, vehicles)
        stakes = [planning.stake_of(option, parameters) for option in options]
        jobs = [
            HorizonJob(task, self._rules, option.slots, residual, stake, guess)
            for option, stake in zip(options, stakes, strict=True)
        ]
        return Proposal(who, options, jobs, problem, snapshot.cycle, vehicles)

    def _guess(self, cycle: int, vehicles: tuple[str, ...]) -> Floats | None:
        """The last winner's multipliers, unless that was long ago or in another run."""
        if self._ended is None or not 0 < cycle - self._ended.cycle <= FORGET_CYCLES:
            return None
        row = self._ended.row
        return carried_over(self._ended.duals, np.array([row.get(vehicle, -1) for vehicle in vehicles]))

    def choose(self, proposal: Proposal, results: Sequence[Outcome | None]) -> Winner | None:
        """Least predicted weighted delay plus a weight times J; the incumbent without a program if all are out.

        Where there are no programs to solve, J is left out.
        """
        if proposal.problem is None:
            return None
        options: Sequence[Candidate] = proposal.candidates
        objectives: list[float | None] = [None if result is None else result.objective for result in results]
        if not proposal.jobs:
            objectives = [0.0] * len(options)
        best = planning.select(options, objectives, self._parameters, solved=bool(proposal.jobs))
        option = options[best or 0]
        outcome = results[best] if results and best is not None else None
        speeds = outcome.speeds if outcome is not None else self._unsolved(proposal.problem, option)
        if isinstance(outcome, HorizonOutcome):
            row = {vehicle: k for k, vehicle in enumerate(proposal.vehicles)}
            self._ended = Ended(proposal.cycle, row, outcome.duals)
        bids = proposal.who.bids[max(option.weights, 0)]
        return Winner(option.weights, option.delay, option.order, option.slots, speeds, bids)

    def _unsolved(self, problem: Demand, option: Candidate) -> Floats:
        """The next speeds without a program: the approach law's own, or full ahead for who does not wait upstream."""
        if not self._parameters.planner.upstream:
            return np.minimum(problem.top, problem.v + problem.a * STEP_S)
        speeds, _, _ = corridor.reference(
            problem.s, problem.v, option.slots, problem.a, problem.b, problem.top, problem.line_cap,
            self._rules.manner, np.array([STEP_S]),
        )  # fmt: skip
        return np.asarray(speeds[:, 0])


class PaperProfile:
    """The paper's sequences and its one-step program on elastic rows; q* has the least J."""

    slotless = True

    def __init__(self, options: ServeOptions, ground: Ground) -> None:
        self._ground = ground
        self._parameters = options.parameters

    def propose(
        self,
        snapshot: Snapshot,
        book: Book,
        limits: Limits,
        who: Bidders,
        previous: tuple[str, ...],
        effort: Ask,
    ) -> Proposal:
        """Up to K sequences over all vehicles that are not past the conflict zone, cleared ones first."""
        del previous, limits
        if not len(who):
            return Proposal(who, (), (), None)
        settings, trying = self._parameters.auction, effort()
        who = who.tried(trying.candidates)
        lines = auction.queues(snapshot.lane[who.index], snapshot.s[who.index], who.index)
        # `who.bids` hold the transfers already
        orders = auction.sequences(who.bids, lines, who.group, settings.slot_value_ratio, 0.0)
        inside = [i for i, vehicle in enumerate(snapshot.ids) if vehicle in book.held]
        inside.sort(key=lambda i: float(snapshot.s[i]))
        members = np.concatenate((who.index, np.array(inside, dtype=np.int64)))
        vehicles = program.traffic(snapshot, members)
        ahead = len(who) + np.arange(len(inside))
        jobs = [
            PaperJob(vehicles, np.concatenate((ahead, order)), self._ground.conflict, self._parameters.program)
            for order in orders
            if trying.programs
        ]
        return Proposal(who, orders, jobs, None)

    def choose(self, proposal: Proposal, results: Sequence[Outcome | None]) -> Winner | None:
        """The sequence of least J; the first one, full ahead under the interlock, where none has a solution."""
        n = len(proposal.who)
        if not n:
            return None
        solved = [(result.objective, k) for k, result in enumerate(results) if result is not None]
        best = min(solved)[1] if solved else 0
        outcome = results[best] if results else None
        order: Ints = proposal.candidates[best]
        speeds = outcome.speeds[:n] if outcome is not None else np.full(n, np.inf)
        delay = outcome.objective if outcome is not None else 0.0
        return Winner(best, delay, order, np.full(n, np.nan), speeds, proposal.who.bids[0])


class StopSign:
    """Everybody drives up to its line and halts; who has stood longest goes as soon as it can cross full ahead."""

    slotless = True

    def __init__(self, options: ServeOptions, ground: Ground) -> None:
        self._ground = ground
        self._accel_share = options.parameters.planner.accel_share
        self._queue: tuple[str, ...] = ()

    def propose(
        self,
        snapshot: Snapshot,
        book: Book,
        limits: Limits,
        who: Bidders,
        previous: tuple[str, ...],
        effort: Ask,
    ) -> Proposal:
        """One order: the queue at the lines, then who has not come to a stand yet, by zone entry."""
        del book, previous, effort
        uncleared = limits.phase == UNCLEARED
        at_line = standing.at_line(snapshot, self._ground)
        self._queue = standing.queue(self._queue, snapshot, uncleared, at_line)
        place = {vehicle: i for i, vehicle in enumerate(snapshot.ids)}
        waiting = np.array([place[vehicle] for vehicle in self._queue], dtype=np.int64)
        row = {int(i): k for k, i in enumerate(who.index)}
        order = [row[int(i)] for i in waiting if int(i) in row]
        order += [row[i] for i in sorted(row) if snapshot.ids[i] not in self._queue]
        asking = np.zeros(len(snapshot), dtype=np.bool_)
        asking[standing.next_to_go(waiting, snapshot, self._ground)] = True
        top, reach = snapshot.v_max[who.index], snapshot.a_max[who.index] * self._accel_share * STEP_S
        winner = Winner(
            0, 0.0, np.array(order, dtype=np.int64), np.full(len(who), np.nan),
            np.minimum(top, snapshot.v[who.index] + reach), who.bids[0], asking,
        )  # fmt: skip
        return Proposal(who, (winner,) if len(who) else (), (), None)

    def choose(self, proposal: Proposal, results: Sequence[Outcome | None]) -> Winner | None:
        """The one there is."""
        del results
        return proposal.candidates[0] if proposal.candidates else None


def strategy_of(options: ServeOptions, ground: Ground) -> Strategy:
    """The strategy of these options, fresh."""
    if options.profile == "paper":
        return PaperProfile(options, ground)
    if options.parameters.interlock.ask == "standing":
        return StopSign(options, ground)
    return DefaultProfile(options, ground)
