"""What the active-set method finds is the solution, whatever it is told to try first."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import daqp
import numpy as np
import pytest
from candidates import PLAY_MPS, RULES, contests, job
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from gameopt_im.core import active_set, horizon
from gameopt_im.core.active_set import PlatoonSolution
from gameopt_im.core.horizon import BOUND, LONGEST, MULTIPLIER, HorizonTask, column_of
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.program import QP, Sparse
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.horizon_job import HorizonJob, PlatoonJob
from gameopt_im.solver.workspace import Workspace, pattern

ROUNDING = 1e-7


def dense(matrix: Sparse) -> Floats:
    rows, columns = matrix.shape
    return np.asarray(csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=(rows, columns)).toarray())


def found(job: PlatoonJob, duals: Floats | None = None) -> PlatoonSolution:
    """The solution, with other multipliers (n, 4, H) for the guess."""
    values = job.values
    if duals is not None:
        values = values.copy()
        values[:, column_of(len(job.blocks), 0, 0) + MULTIPLIER * len(job.blocks) :] = duals.reshape(len(values), -1)
    solution = active_set.solve(values, job.blocks, PLAY_MPS)
    assert solution is not None
    return solution


def program(job: PlatoonJob) -> QP:
    return horizon.program(job.values, job.blocks)[0]


def in_rows(duals: Floats) -> Floats:
    """(m,) multipliers (n, 4, H) in the order of a platoon's rows."""
    kinds = [duals[:, kind].ravel() for kind in range(3)]
    return np.concatenate([*kinds, duals[1:, 3].ravel()])


@given(made=contests())
@settings(max_examples=100)
def test_it_is_the_optimum(made: list[HorizonJob]) -> None:
    """The conditions of optimality: nothing violated, no gradient left, multipliers of the right sign on what binds."""
    for each in made[0].programs():
        solution, qp = found(each), program(each)
        x, y = solution.u.ravel(), in_rows(solution.duals)
        ax = dense(qp.A) @ x
        assert np.all((qp.l - ROUNDING <= ax) & (ax <= qp.u + ROUNDING))
        assert solution.residual == pytest.approx(max(0.0, (qp.l - ax).max(), (ax - qp.u).max()), abs=1e-12)
        upper = dense(qp.P)
        gradient = (upper + np.triu(upper, 1).T) @ x + qp.q
        np.testing.assert_allclose(gradient + dense(qp.A).T @ y, 0.0, atol=1e-6 * (1.0 + np.abs(qp.q).max()))
        assert np.all(np.abs(ax - qp.u)[y > ROUNDING] < ROUNDING)
        assert np.all(np.abs(ax - qp.l)[y < -ROUNDING] < ROUNDING)


@given(made=contests())
@settings(max_examples=30)
def test_other_solvers_come_to_the_same(made: list[HorizonJob]) -> None:
    """OSQP as near as it comes, and DAQP exactly: another active-set method, on dense rows."""
    for each in made[0].programs():
        qp, mine = program(each), found(each).u.ravel()
        osqp = Workspace(residual_mps=1e-5, max_iter=200_000).solve(pattern(qp), qp)
        assert osqp is not None
        assert objective(qp, mine) == pytest.approx(objective(qp, osqp.x), rel=1e-4, abs=1e-3)
        np.testing.assert_allclose(mine, osqp.x, atol=5e-3)
        assert_as_daqp(qp, mine)


def assert_as_daqp(qp: QP, mine: Floats) -> None:
    upper = dense(qp.P)
    cost, sense = upper + np.triu(upper, 1).T, np.zeros(len(qp.l), dtype=np.int32)
    x, _, flag, _ = daqp.solve(cost, qp.q, dense(qp.A), qp.u, qp.l, sense, primal_tol=1e-9)
    assert flag == 1
    np.testing.assert_allclose(mine, x, atol=1e-6)


@given(made=contests(), seed=st.integers(0, 2**32))
@settings(max_examples=100)
def test_the_guess_decides_nothing(made: list[HorizonJob], seed: int) -> None:
    random = np.random.default_rng(seed)
    for each in made[0].programs():
        plain = found(each)
        shape = plain.duals.shape
        for duals in (plain.duals, random.normal(size=shape) * (random.random(shape) < random.random())):
            np.testing.assert_allclose(found(each, duals).u, plain.u, atol=ROUNDING)
        assert found(each, plain.duals).steps <= 2


@given(made=contests())
@settings(max_examples=30)
def test_where_it_gives_up_splitting_is_tried(made: list[HorizonJob]) -> None:
    jobs = made[0].programs()
    exact = [each.by_active_set() for each in jobs]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(active_set, "solve", lambda *_: None)
        for each, best in zip(jobs, exact, strict=True):
            other = each.solve()
            assert best is not None
            assert other is not None
            assert other.residual <= PLAY_MPS
            np.testing.assert_allclose(other.u, best.u, atol=0.1)


def test_there_is_no_other_attempt_when_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    late = platoon._replace(until_s=time.monotonic())
    assert late.solve() is not None
    monkeypatch.setattr(active_set, "STEPS", -1)
    assert platoon.by_active_set() is None
    assert platoon.solve() is not None
    assert late.solve() is None


def test_guesses_from_elsewhere_on_full_platoons() -> None:
    """Ten vehicles over the service's own horizon; what bound another candidate's program, or what OSQP found."""
    random = np.random.default_rng(5)
    jobs = full_platoons(random)
    for first, second in pairwise(jobs):
        best, other = first.by_active_set(), first.by_splitting()
        assert best is not None
        assert other is not None
        plain = second.by_active_set()
        assert plain is not None
        assert_as_daqp(program(second), plain.u.ravel())
        for duals in (best.duals, other.duals):
            np.testing.assert_allclose(found(second, duals).u, plain.u, atol=ROUNDING)


def full_platoons(random: np.random.Generator) -> list[PlatoonJob]:
    """Eight candidates for ten vehicles behind each other."""
    n, blocks = LONGEST, Parameters().program.blocks_s
    task = HorizonTask(
        counts=(n,), s=np.cumsum(random.uniform(8.0, 20.0, n)), v=random.uniform(3.0, 9.0, n), length=np.full(n, 5.0),
        a=np.full(n, 2.0), b=np.full(n, 4.5), top=np.full(n, 20.0), line_cap=random.choice([9.0, 20.0], n),
        ps=random.uniform(0.8, 5.0, n), pv=random.uniform(0.5, 2.5, n), room=np.full((n, len(blocks)), NEVER),
        trails=np.zeros(n, dtype=np.bool_),
    )  # fmt: skip
    rules = replace(RULES, blocks=blocks)
    slots = 3.0 + np.cumsum(random.uniform(1.5, 3.0, n))
    made = [HorizonJob(task, rules, slots + np.sort(random.exponential(1.0, n)), PLAY_MPS) for _ in range(8)]
    return [platoon for each in made for platoon in each.programs()]


COLUMNS = {"P": 0, "q": 5, "l": 8, "u": 8 + 3 * BOUND}
"""Where they begin in what a platoon of three blocks is given as."""


@pytest.mark.parametrize("what", COLUMNS)
@pytest.mark.parametrize("vehicle", [0, 1])
def test_what_is_not_a_number_is_no_solution(what: str, vehicle: int) -> None:
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    platoon.values[vehicle, COLUMNS[what]] = np.nan
    assert active_set.solve(platoon.values, platoon.blocks, PLAY_MPS) is None


def test_a_guess_that_is_no_number_decides_nothing() -> None:
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    plain = found(platoon)
    np.testing.assert_allclose(found(platoon, np.full_like(plain.duals, np.nan)).u, plain.u, atol=ROUNDING)
