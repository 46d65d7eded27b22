"""The horizon program of one candidate, as a job for the pool."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gameopt_im.core import duality, horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask, Start
from gameopt_im.core.kinematics import manner_of
from gameopt_im.core.parameters import Planner
from gameopt_im.core.planning import Stake
from gameopt_im.core.program import QP, Csc
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.jobs import Outcome
from gameopt_im.solver.workspace import Solution, kept_workspace

COST_SCALE = 0.005
"""The program's cost is scaled by this: J may be off by more than the speeds are."""
QUICK_RHO, QUICK_ITERATIONS = 0.125, 250
SAFE_RHO, SAFE_ITERATIONS = 0.5, 1500
"""Step size and most iterations. The quick one mostly needs half as many, but now and then goes round in circles."""
ALPHA = 1.8
ROW_LENGTHS = (1.0, 0.5, 0.7, 1.2)
"""Relaxation, and lengths of corridor, speed, change and rear-end rows: with the quick step size, those that took the
fewest iterations on recorded programs that start where the last control cycle's ended.
"""
CHECK = 5
"""Iterations from one look at the residuals to the next: a good start needs few."""
KNOWN_LANES = 256
"""Solutions of lanes that are remembered: more than a control cycle's candidates have lanes."""
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

    def solve(self) -> HorizonOutcome | None:
        """Speeds for the next control cycle and J."""
        solutions, first = [], 0
        for (qp, reference), count in zip(
            horizon.build(self.task, self.rules, self.slots), self.task.counts, strict=True
        ):
            x, y = reference, np.zeros(len(qp.l))
            if self.start is not None:
                u = self.start.u[first : first + count].ravel()
                x, y = np.where(np.isnan(u), x, u), horizon.in_rows(self.start.duals[first : first + count])
            solution = _lane(qp, x, y, self.residual_mps)
            if solution is None:
                return None
            solutions.append(solution)
            first += count
        u = np.concatenate([solution.x for solution in solutions])
        duals = [horizon.by_vehicle(each.y, count) for each, count in zip(solutions, self.task.counts, strict=True)]
        return HorizonOutcome(
            horizon.first_speeds(self.task, self.rules, u),
            horizon.objective(self.task, self.rules, u),
            max(solution.residual for solution in solutions),
            Start(u.reshape(len(self.slots), -1), np.concatenate(duals)),
        )

    def may_cost(self, duals: Floats) -> float:
        """The least that any solution can cost, judged by the multipliers (n, 4, H) of another candidate."""
        given = horizon.bounds(self.task, self.rules, self.slots)
        return self.stake.cost(duality.least_objective(self.task, self.rules, given, duals, self.residual_mps))


_known: OrderedDict[bytes, Solution | None] = OrderedDict()


def _lane(qp: QP, start: Floats, duals: Floats, residual_mps: float) -> Solution | None:
    """The solution of one lane's program; candidates that leave a lane its slots have it solved once."""
    key = b"".join(part.tobytes() for part in (qp.P.data, qp.q, qp.l, qp.u, start, duals))
    if key not in _known:
        _known[key] = _attempted(qp, start, duals, residual_mps)
        if len(_known) > KNOWN_LANES:
            _known.popitem(last=False)
    return _known[key]


def _attempted(qp: QP, start: Floats, duals: Floats, residual_mps: float) -> Solution | None:
    """The solution by the quick step size, or else by the safe one, without the multipliers that may be at fault."""
    lengths, scaled = _row_lengths(*qp.A.shape), _scaled(qp)
    none = np.zeros_like(duals)
    for rho, iterations, y in ((QUICK_RHO, QUICK_ITERATIONS, duals), (SAFE_RHO, SAFE_ITERATIONS, none)):
        workspace = kept_workspace(
            residual_mps=residual_mps, max_iter=iterations, rho=rho, alpha=ALPHA, tolerance=TOLERANCE, capacity=128,
            check=CHECK,
        )  # fmt: skip
        solution = workspace.solve(qp.A.shape, scaled, start, y * COST_SCALE, lengths)
        if solution is not None:
            return replace(solution, y=solution.y / COST_SCALE)
    return None


@lru_cache(maxsize=512)
def _row_lengths(rows: int, columns: int) -> Floats:
    """(m,) `ROW_LENGTHS` in the order of a lane's rows: of three kinds as many as there are variables."""
    return np.repeat(ROW_LENGTHS, [columns, columns, columns, rows - 3 * columns])


def _scaled(qp: QP) -> QP:
    p = Csc((qp.P.shape[0], qp.P.shape[1]), qp.P.data * COST_SCALE, qp.P.indices, qp.P.indptr)
    return replace(qp, P=p, q=qp.q * COST_SCALE)


def warm_up() -> list[HorizonJob]:
    """A small job that compiles, or loads, what a worker will need."""
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
    )
    rules = HorizonRules((1.0, 1.0), 0.7, 2.0, manner_of(Planner()))
    return [HorizonJob(task, rules, np.array([5.0, 7.0]), 1e-3)]
