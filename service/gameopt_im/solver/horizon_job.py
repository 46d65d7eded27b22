"""The horizon program of one candidate, as a job for the pool."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace

import numpy as np

from gameopt_im.core import horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask
from gameopt_im.core.kinematics import manner_of
from gameopt_im.core.parameters import Planner
from gameopt_im.core.planning import Stake
from gameopt_im.core.program import QP, Csc
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.jobs import Outcome
from gameopt_im.solver.workspace import Solution, kept_workspace

COST_SCALE = 0.02
"""The program's cost is scaled by this: multipliers and residuals are then of one size."""
RHO = 0.5
ALPHA = 1.8
"""Step size and relaxation that took the fewest iterations on recorded programs of rows of length 1."""
KNOWN_LANES = 256
"""Solutions of lanes that are remembered: more than a control cycle's candidates have lanes."""
MAX_ITERATIONS = 1000
ALONE = Stake(0.0, 1.0, 0.0)
"""The stake of a candidate that nothing is compared with."""
TOLERANCE = 0.4
"""Share of the residual allowed that the solver is asked for."""


@dataclass(frozen=True, slots=True)
class HorizonOutcome(Outcome):
    """An outcome with the multipliers (n, 4, H) of the rows, to judge other candidates by."""

    duals: Floats


@dataclass(frozen=True, slots=True)
class HorizonJob:
    """One candidate's slots (n,), s, for the task its control cycle shares, and its stake in the choice of q*."""

    task: HorizonTask
    rules: HorizonRules
    slots: Floats
    residual_mps: float
    stake: Stake = ALONE

    def solve(self) -> HorizonOutcome | None:
        """Speeds for the next control cycle and J; starts from the approach law, so from the snapshot alone."""
        solutions = []
        for qp, reference in horizon.build(self.task, self.rules, self.slots):
            solution = _lane(qp, reference, self.residual_mps)
            if solution is None:
                return None
            solutions.append(solution)
        u = np.concatenate([solution.x for solution in solutions])
        duals = [horizon.by_vehicle(each.y, count) for each, count in zip(solutions, self.task.counts, strict=True)]
        return HorizonOutcome(
            horizon.first_speeds(self.task, self.rules, u),
            horizon.objective(self.task, self.rules, u),
            max(solution.residual for solution in solutions),
            np.concatenate(duals) / COST_SCALE,
        )

    def may_cost(self, duals: Floats) -> float:
        """The least that any solution can cost, judged by the multipliers of another candidate."""
        given = horizon.bounds(self.task, self.rules, self.slots)
        return self.stake.cost(horizon.least_objective(self.task, self.rules, given, duals, self.residual_mps))


_known: OrderedDict[bytes, Solution | None] = OrderedDict()


def _lane(qp: QP, reference: Floats, residual_mps: float) -> Solution | None:
    """The solution of one lane's program; candidates that leave a lane its slots have it solved once."""
    key = b"".join(part.tobytes() for part in (qp.P.data, qp.q, qp.l, qp.u, reference))
    if key not in _known:
        workspace = kept_workspace(
            residual_mps=residual_mps, max_iter=MAX_ITERATIONS, rho=RHO, alpha=ALPHA, tolerance=TOLERANCE,
            capacity=128, unit_rows=True,
        )  # fmt: skip
        _known[key] = workspace.solve(len(qp.q), _scaled(qp), reference)
        if len(_known) > KNOWN_LANES:
            _known.popitem(last=False)
    return _known[key]


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
