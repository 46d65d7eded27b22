"""The horizon program of one candidate, as a job for the pool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gameopt_im.core import duality, horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask, Start
from gameopt_im.core.kinematics import manner_of
from gameopt_im.core.parameters import Planner
from gameopt_im.core.planning import Stake
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.jobs import Outcome
from gameopt_im.solver.workspace import kept_workspace

COST_SCALE = 0.005
"""The program's cost is scaled by this: J may be off by more than the speeds are."""
QUICK_RHO, QUICK_ITERATIONS = 0.125, 250
SAFE_RHO, SAFE_ITERATIONS = 0.5, 2500
"""Step size and most iterations. The quick one mostly needs half as many, but now and then goes round in circles."""
ALPHA = 1.8
ROW_LENGTHS = (1.0, 0.5, 0.7, 1.2)
"""Relaxation, and lengths of corridor, speed, change and rear-end rows: with the quick step size, those that took the
fewest iterations on recorded programs that start where the last control cycle's ended.
"""
CHECK = 5
"""Iterations from one look at the residuals to the next: a good start needs few."""
ALONE = Stake(0.0, 1.0, 0.0)
"""The stake of a candidate that nothing is compared with."""
TOLERANCE = 0.4
"""Share of the residual allowed that the solver is asked for."""


@dataclass(frozen=True, slots=True)
class HorizonOutcome(Outcome):
    """An outcome with where it ended: the next control cycle starts there, and other candidates are judged by it."""

    end: Start


@dataclass(frozen=True, slots=True)
class HorizonJob:
    """One candidate's slots (n,), s, for the task its control cycle shares, and its stake in the choice of q*.

    `start` is where the last control cycle's winner ended: it depends on what was chosen then, and nothing else.
    """

    task: HorizonTask
    rules: HorizonRules
    slots: Floats
    residual_mps: float
    stake: Stake = ALONE
    start: Start | None = None

    def met(self) -> list[tuple[int, bytes]]:
        """Each platoon, its slots and that of whom it trails: all that its program depends on in a control cycle."""
        ends = np.cumsum(self.task.counts)
        firsts = ends - self.task.counts
        firsts = firsts - self.task.trails[firsts]
        return [
            (number, self.slots[first:end].tobytes())
            for number, (first, end) in enumerate(zip(firsts, ends, strict=True))
        ]

    def programs(self) -> list[PlatoonJob]:
        """Its programs, which different workers may solve."""
        values = horizon.build(self.task, self.rules, self.slots, self.start)
        ends = np.cumsum(self.task.counts)
        return [
            PlatoonJob(values[end - count : end], self.rules.blocks, self.residual_mps)
            for count, end in zip(self.task.counts, ends, strict=True)
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
            Start(u, np.concatenate([solution.duals for solution in solved])),
        )

    def solve(self) -> HorizonOutcome | None:
        """All of it, platoon by platoon."""
        return self.joined([job.solve() for job in self.programs()])

    def may_cost(self, duals: Floats) -> float:
        """The least that any solution can cost, judged by the multipliers (n, 4, H) of another candidate."""
        given = horizon.bounds(self.task, self.rules, self.slots)
        return self.stake.cost(duality.least_objective(self.task, self.rules, given, duals, self.residual_mps))


class PlatoonSolution(NamedTuple):
    """Speeds at the ends of the blocks (m, H), multipliers (m, 4, H), and the largest violation of a row, m/s."""

    u: Floats
    duals: Floats
    residual: float


class PlatoonJob(NamedTuple):
    """One program of a candidate: its rows of `horizon.build`."""

    values: Floats
    blocks: tuple[float, ...]
    residual_mps: float

    def solve(self) -> PlatoonSolution | None:
        """The solution by the quick step size, or else by the safe one from zero multipliers: those may be at fault."""
        qp, x, duals = horizon.program(self.values, self.blocks, COST_SCALE)
        count, h = len(self.values), len(self.blocks)
        for rho, iterations, y in ((QUICK_RHO, QUICK_ITERATIONS, duals), (SAFE_RHO, SAFE_ITERATIONS, None)):
            workspace = kept_workspace(
                residual_mps=self.residual_mps, max_iter=iterations, rho=rho, alpha=ALPHA, tolerance=TOLERANCE,
                capacity=128, check=CHECK,
            )  # fmt: skip
            solution = workspace.solve(qp.A.shape, qp, x, y, _row_lengths(*qp.A.shape))
            if solution is not None:
                multipliers = horizon.by_vehicle(solution.y, count, COST_SCALE)
                return PlatoonSolution(solution.x.reshape(count, h), multipliers, solution.residual)
        return None


@lru_cache(maxsize=512)
def _row_lengths(rows: int, columns: int) -> Floats:
    """(m,) `ROW_LENGTHS` in the order of a platoon's rows: of three kinds as many as there are variables."""
    return np.repeat(ROW_LENGTHS, [columns, columns, columns, rows - 3 * columns])


def warm_up() -> HorizonJob:
    """A small job that compiles, or loads, what this process and a worker will need."""
    one = np.ones(2)
    task = HorizonTask(
        counts=(2,),
        s=np.array([60.0, 80.0]),
        v=15.0 * one,
        length=5.0 * one,
        a=2.0 * one,
        b=4.5 * one,
        top=20.0 * one,
        line_cap=20.0 * one,
        ps=one,
        pv=one,
        room=np.full((2, 2), 1e9),
        trails=np.zeros(2, dtype=np.bool_),
    )
    rules = HorizonRules((1.0, 1.0), 0.7, 2.0, manner_of(Planner()))
    return HorizonJob(task, rules, np.array([5.0, 7.0]), 1e-3)
