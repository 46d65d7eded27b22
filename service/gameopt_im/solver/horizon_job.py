"""The horizon program of one candidate, as a job for the pool."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from gameopt_im.core import active_set, duality, horizon
from gameopt_im.core.active_set import PlatoonSolution
from gameopt_im.core.horizon import LONGEST, HorizonRules, HorizonTask
from gameopt_im.core.kinematics import manner_of
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import Stake
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.jobs import Outcome
from gameopt_im.solver.workspace import Workspace, kept_workspace

COST_SCALE = 0.005
"""What OSQP sees of the cost: J may be off by more than the speeds are."""
RHO, ALPHA, ITERATIONS = 0.5, 1.8, 2500
ROW_LENGTHS = (1.0, 0.5, 0.7, 1.2)
"""Its step size, relaxation and most iterations, and lengths of corridor, speed, change and rear-end rows. A quarter of
the step size needs half as many iterations on most programs, but goes round in circles on some.
"""
CHECK = 5
"""Iterations from one look at the residuals to the next."""
ALONE = Stake(0.0, 1.0, 0.0)
"""The stake of a candidate that nothing is compared with."""
TOLERANCE = 0.4
"""Share of the residual allowed that the solver is asked for."""


@dataclass(frozen=True, slots=True)
class HorizonOutcome(Outcome):
    """An outcome with its multipliers (n, 4, H): the next control cycle's guess, and what others are judged by."""

    duals: Floats


@dataclass(frozen=True, slots=True)
class HorizonJob:
    """One candidate's slots (n,), s, for the task its control cycle shares, and its stake in the choice of q*.

    `guess` are the multipliers (n, 4, H) of the last control cycle's winner: they depend on what was chosen then, and
    nothing else.
    """

    task: HorizonTask
    rules: HorizonRules
    slots: Floats
    residual_mps: float
    stake: Stake = ALONE
    guess: Floats | None = None

    def met(self) -> list[tuple[int, bytes]]:
        """Each platoon, its slots and that of whom it trails: all that its program depends on in a control cycle."""
        trails = self.task.trails
        return [
            (number, self.slots[first - trails[first] : end].tobytes())
            for number, (first, end) in enumerate(_parts(self.task.counts))
        ]

    def programs(self, until_s: float | None = None) -> list[PlatoonJob]:
        """Its programs, which different workers may solve."""
        values = horizon.build(self.task, self.rules, self.slots, self.guess)
        return [
            PlatoonJob(values[first:end], self.rules.blocks, self.residual_mps, until_s)
            for first, end in _parts(self.task.counts)
        ]

    def joined(self, solutions: Sequence[PlatoonSolution | None]) -> HorizonOutcome | None:
        """Speeds for the next control cycle and J, from the solutions of all platoons."""
        solved = [solution for solution in solutions if solution is not None]
        if len(solved) < len(self.task.counts):
            return None
        u = np.concatenate([solution.u for solution in solved])
        return HorizonOutcome(
            horizon.first_speeds(self.task, self.rules, u),
            horizon.objective(self.task, self.rules, u),
            max(solution.residual for solution in solved),
            np.concatenate([solution.duals for solution in solved]),
        )

    def solve(self) -> HorizonOutcome | None:
        """All of it, platoon by platoon."""
        return self.joined([job.solve() for job in self.programs()])


@lru_cache(maxsize=512)
def _parts(counts: tuple[int, ...]) -> list[tuple[int, int]]:
    """Where each platoon begins and ends."""
    return list(pairwise(accumulate(counts, initial=0)))


def least_costs(candidates: Sequence[HorizonJob], duals: Floats) -> list[float]:
    """The least that any solution of each can cost, judged by the multipliers (n, 4, H) of another of their task."""
    task, rules, play = candidates[0].task, candidates[0].rules, candidates[0].residual_mps
    least = duality.least_objectives(task, rules, np.array([each.slots for each in candidates]), duals, play)
    return [each.stake.cost(value) for each, value in zip(candidates, least.tolist(), strict=True)]


class PlatoonJob(NamedTuple):
    """One program of a candidate: its rows of `horizon.build`."""

    values: Floats
    blocks: tuple[float, ...]
    residual_mps: float
    until_s: float | None = None
    """On the monotonic clock: after this there is no time for another attempt, which can take ten times as long."""

    def weight(self) -> float:
        """How long it takes, in the units of `shares.SENDING`: measured, 16 us for one vehicle and 95 for ten."""
        return 0.4 + len(self.values) * (len(self.values) + 8) / 64.0

    def solve(self) -> PlatoonSolution | None:
        """The solution by the active set, or else by splitting."""
        found = self.by_active_set()
        if found is None and (self.until_s is None or time.monotonic() < self.until_s):
            found = self.by_splitting()
        return found

    def by_active_set(self) -> PlatoonSolution | None:
        """The solution by what binds, which is as good as exactly kept."""
        return active_set.solve(self.values, self.blocks, self.residual_mps)

    def by_splitting(self) -> PlatoonSolution | None:
        """OSQP's, to the residual allowed, from the approach law's speeds: the guess may be at fault."""
        qp, reference = horizon.program(self.values, self.blocks, COST_SCALE)
        solution = _workspace(self.residual_mps).solve(qp.A.shape, qp, reference, _row_lengths(*qp.A.shape))
        if solution is None:
            return None
        count, h = len(self.values), len(self.blocks)
        multipliers = horizon.by_vehicle(solution.y, count, COST_SCALE)
        return PlatoonSolution(solution.x.reshape(count, h), multipliers, solution.residual, solution.iterations)


def _workspace(residual_mps: float) -> Workspace:
    return kept_workspace(
        residual_mps=residual_mps, max_iter=ITERATIONS, rho=RHO, alpha=ALPHA, tolerance=TOLERANCE, capacity=128,
        check=CHECK,
    )  # fmt: skip


@lru_cache(maxsize=512)
def _row_lengths(rows: int, columns: int) -> Floats:
    """(m,) `ROW_LENGTHS` in the order of a platoon's rows: of three kinds as many as there are variables."""
    return np.repeat(ROW_LENGTHS, [columns, columns, columns, rows - 3 * columns])


class WarmUp(NamedTuple):
    """A program to set a workspace up for: that takes longer than to solve it, and no control cycle may wait."""

    job: PlatoonJob

    def solve(self) -> None:
        """Solve it in either way."""
        self.job.by_active_set()
        self.job.by_splitting()


def warm_up(parameters: Parameters) -> HorizonJob:
    """A job with a platoon of every size: what this process and a worker will need is compiled, or loaded, for it."""
    settings = parameters.program
    counts = tuple(range(1, LONGEST + 1))
    n, h = sum(counts), len(settings.blocks_s)
    one = np.ones(n)
    task = HorizonTask(
        counts=counts,
        s=np.concatenate([60.0 + 20.0 * np.arange(count) for count in counts]),
        v=15.0 * one,
        length=5.0 * one,
        a=2.0 * one,
        b=4.5 * one,
        top=20.0 * one,
        line_cap=20.0 * one,
        ps=one,
        pv=one,
        room=np.full((n, h), 1e9),
        trails=np.zeros(n, dtype=np.bool_),
    )
    rules = HorizonRules(settings.blocks_s, settings.lambda_, settings.rear_gap_m, manner_of(parameters.planner))
    return HorizonJob(task, rules, 0.1 * task.s, settings.residual_mps)
