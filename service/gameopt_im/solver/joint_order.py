"""The joint problem of order and speeds, solved by SCIP: what the auction and its programs are compared with.

SCIP is an extra (`pip install gameopt[optimal]`), and no part of the manager: nothing else imports this.
"""

from __future__ import annotations

from dataclasses import dataclass
from graphlib import TopologicalSorter
from itertools import combinations, permutations
from time import process_time
from typing import Any, TypeAlias

import numpy as np
from pyscipopt import Model, quicksum

from gameopt_im.core.joint import Joint
from gameopt_im.core.program import LATERAL_PENALTY, REAR_END_PENALTY, Rows
from gameopt_im.core.snapshot import Ints

GAP = 1e-6
"""Relative gap between solution and bound at which it counts as optimal."""

PROCESSOR = 1
"""SCIP's name for this clock."""

Term: TypeAlias = Any
"""A variable, expression or number of SCIP's."""


@dataclass(frozen=True, slots=True)
class Answer:
    """`order` (n,) of the best solution, its objective, a bound below every other, and the processor time it took.

    `optimal` is False where the limit of time came first; `order` is None where no solution was found by then.
    """

    order: Ints | None
    objective: float
    bound: float
    seconds: float
    optimal: bool


def solve(problem: Joint, limit_s: float) -> Answer:
    """Solve from scratch on one core; times are its processor times, so that nothing else on the machine counts."""
    started = process_time()
    model = Model()
    model.hideOutput()
    model.setParam("timing/clocktype", PROCESSOR)
    model.setParam("limits/time", limit_s)
    model.setParam("limits/gap", GAP)
    before = _order_variables(model, problem)
    _speeds_and_rows(model, problem, before)
    model.optimize()
    seconds = process_time() - started
    found = model.getNSols() > 0
    return Answer(
        order=_order(model, problem, before) if found else None,
        objective=float(model.getObjVal()) if found else np.inf,
        bound=float(model.getDualbound()),
        seconds=seconds,
        optimal=model.getStatus() in ("optimal", "gaplimit"),
    )


def _order_variables(model: Model, problem: Joint) -> list[list[Term]]:
    """before[i][j], 1 where i goes before j: a binary for each pair whose order is free, and no cycle of three.

    A complete orientation without a cycle of three has none at all: it is a total order.
    """
    n, ordered, free = len(problem), problem.ordered.tolist(), problem.free
    before: list[list[Term]] = [[0] * n for _ in range(n)]
    for i, j in combinations(range(n), 2):
        first = model.addVar(vtype="B") if free[i, j] else int(problem.before[i, j])
        before[i][j], before[j][i] = first, 1 - first
    for i, j, k in combinations(ordered, 3):
        around = before[i][j] + before[j][k] + before[k][i]
        if not isinstance(around, int):
            model.addCons(around <= 2)
            model.addCons(around >= 1)
    return before


def _speeds_and_rows(model: Model, problem: Joint, before: list[list[Term]]) -> None:
    """Speeds, slacks and the objective; every square below a variable of its own, which SCIP bounds best."""
    u = [model.addVar(lb=low, ub=high) for low, high in zip(problem.lower, problem.upper, strict=True)]
    costs = [
        _cost(model, speed, half * 0.5, linear)
        for speed, half, linear in zip(u, problem.quadratic, problem.linear, strict=True)
    ]
    for left, _, _ in _left_sides(problem.rear_end, u):
        slack = model.addVar(lb=0.0)
        model.addCons(left <= slack)
        costs.append(_cost(model, slack, REAR_END_PENALTY[1], REAR_END_PENALTY[0]))
    for (left, i, j), least, most in zip(
        _left_sides(problem.lateral, u), problem.least.tolist(), problem.most.tolist(), strict=True
    ):
        if most <= 0.0:
            continue  # met by all speeds within the boxes
        slack, active = model.addVar(lb=0.0, ub=most), before[i][j]
        model.addCons(left - most * (1 - active) <= slack)
        if least > 0.0:
            model.addCons(least * active <= slack)  # implied where orders are whole; tightens the relaxation
        costs.append(_cost(model, slack, LATERAL_PENALTY[1], LATERAL_PENALTY[0]))
    model.setObjective(quicksum(costs) + problem.constant, "minimize")


def _left_sides(rows: Rows, u: list[Term]) -> list[tuple[Term, int, int]]:
    """(c_target u_target - c_source u_source - bound, source, target) of every row."""
    columns = (getattr(rows, name).tolist() for name in Rows.__dataclass_fields__)
    return [
        (c_target * u[target] - c_source * u[source] - bound, source, target)
        for source, target, c_source, c_target, bound in zip(*columns, strict=True)
    ]


def _cost(model: Model, x: Term, quadratic: float, linear: float) -> Term:
    """A term of the objective: linear x + a variable no less than quadratic x^2."""
    square = model.addVar(lb=0.0)
    model.addCons(float(quadratic) * x * x <= square)
    return float(linear) * x + square


def _order(model: Model, problem: Joint, before: list[list[Term]]) -> Ints:
    """The vehicles in an order that says what the solution says."""
    ahead: dict[int, set[int]] = {j: set(np.flatnonzero(problem.before[:, j]).tolist()) for j in range(len(problem))}
    for i, j in permutations(problem.ordered.tolist(), 2):
        if not isinstance(before[i][j], int) and model.getVal(before[i][j]) > 0.5:
            ahead[j].add(i)
    return np.fromiter(TopologicalSorter(ahead).static_order(), dtype=np.int64, count=len(problem))
