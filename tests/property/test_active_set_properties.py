"""What the active-set method finds is the solution, whatever it is told to try first."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from candidates import PLAY_MPS, contests, job
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from gameopt_im.core import horizon
from gameopt_im.core.horizon import Programmed
from gameopt_im.core.program import Sparse
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver import active_set
from gameopt_im.solver.horizon_job import HorizonJob
from gameopt_im.solver.workspace import Solution, Workspace, pattern

ROUNDING = 1e-7


def dense(matrix: Sparse) -> Floats:
    rows, columns = matrix.shape
    return np.asarray(csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=(rows, columns)).toarray())


def programs(made: list[HorizonJob]) -> list[Programmed]:
    return [horizon.program(job.values, job.blocks) for job in made[0].programs()]


def found(given: Programmed, blocks: tuple[float, ...]) -> Solution:
    solution = active_set.solve(given, blocks, PLAY_MPS)
    assert solution is not None
    return solution


@given(made=contests())
@settings(max_examples=100)
def test_it_is_the_optimum(made: list[HorizonJob]) -> None:
    """The conditions of optimality: nothing violated, no gradient left, multipliers of the right sign on what binds."""
    for each in programs(made):
        solution, qp = found(each, made[0].rules.blocks), each.qp
        x, y = solution.x, solution.y
        assert solution.residual <= ROUNDING
        upper = dense(qp.P)
        gradient = (upper + np.triu(upper, 1).T) @ x + qp.q
        np.testing.assert_allclose(gradient + dense(qp.A).T @ y, 0.0, atol=1e-6 * (1.0 + np.abs(qp.q).max()))
        ax = dense(qp.A) @ x
        assert np.all(np.abs(ax - qp.u)[y > ROUNDING] < ROUNDING)
        assert np.all(np.abs(ax - qp.l)[y < -ROUNDING] < ROUNDING)


@given(made=contests())
@settings(max_examples=30)
def test_osqp_comes_to_the_same(made: list[HorizonJob]) -> None:
    for each in programs(made):
        other = Workspace(residual_mps=1e-5, max_iter=200_000).solve(pattern(each.qp), each.qp)
        assert other is not None
        mine = found(each, made[0].rules.blocks)
        assert mine.objective == pytest.approx(other.objective, rel=1e-4, abs=1e-3)
        np.testing.assert_allclose(mine.x, other.x, atol=5e-3)


@given(made=contests(), seed=st.integers(0, 2**32))
@settings(max_examples=100)
def test_the_guess_decides_nothing(made: list[HorizonJob], seed: int) -> None:
    random = np.random.default_rng(seed)
    for each in programs(made):
        plain = found(each, made[0].rules.blocks)
        for y in (plain.y, random.normal(size=len(each.y)) * (random.random(len(each.y)) < random.random())):
            guessed = found(each._replace(y=y), made[0].rules.blocks)
            np.testing.assert_allclose(guessed.x, plain.x, atol=ROUNDING)
        assert found(each._replace(y=plain.y), made[0].rules.blocks).iterations <= 2


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
    monkeypatch.setattr(active_set, "STEPS", 0)
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    assert platoon.by_active_set() is None
    assert platoon.solve() is not None
    assert platoon._replace(until_s=time.monotonic()).solve() is None


@pytest.mark.parametrize("what", ["q", "l", "u"])
def test_what_is_not_a_number_has_no_solution(what: str) -> None:
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    given = horizon.program(platoon.values, platoon.blocks)
    spoilt = getattr(given.qp, what).copy()
    spoilt[0] = np.nan
    assert active_set.solve(given._replace(qp=replace(given.qp, **{what: spoilt})), platoon.blocks, PLAY_MPS) is None
