"""What the active-set method finds is the solution, whatever it is told to try first."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from candidates import PLAY_MPS, RULES, contests, job
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from gameopt_im.core import horizon
from gameopt_im.core.horizon import LONGEST, HorizonTask, Programmed
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.program import Csc, Sparse
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver import active_set
from gameopt_im.solver.horizon_job import HorizonJob, PlatoonJob
from gameopt_im.solver.solution import Solution
from gameopt_im.solver.workspace import Workspace, pattern

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
        assert objective(each.qp, mine.x) == pytest.approx(objective(each.qp, other.x), rel=1e-4, abs=1e-3)
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
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    late = platoon._replace(until_s=time.monotonic())
    assert late.solve() is not None
    monkeypatch.setattr(active_set, "STEPS", 0)
    monkeypatch.setattr(active_set, "OPTIMAL", 0)
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
        for duals in (best.duals, other.duals):
            guessed = horizon.program(second.values, second.blocks)._replace(y=in_rows(duals))
            solution = found(guessed, second.blocks)
            np.testing.assert_allclose(solution.x, plain.u.ravel(), atol=ROUNDING)


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


def in_rows(duals: Floats) -> Floats:
    """(m,) multipliers (n, 4, H) in the order of a platoon's rows."""
    n, h = len(duals), duals.shape[2]
    y = np.zeros((4 * n - 1) * h)
    for i in range(n):
        for kind in range(4 if i else 3):
            for k in range(h):
                y[horizon.row_of(n, h, i, kind, k)] = duals[i, kind, k]
    return y


@pytest.mark.parametrize("what", ["q", "l", "u", "P", "y"])
def test_what_is_not_a_number_is_no_solution(what: str) -> None:
    (platoon,) = job([5.0, 7.0], 0.0).programs()
    given = horizon.program(platoon.values, platoon.blocks)
    best = found(given, platoon.blocks)
    if what == "y":  # a guess decides nothing
        spoilt = active_set.solve(given._replace(y=np.full_like(given.y, np.nan)), platoon.blocks, PLAY_MPS)
        assert spoilt is not None
        np.testing.assert_allclose(spoilt.x, best.x, atol=ROUNDING)
        return
    for place in (0, -1):
        qp = given.qp
        if what == "P":
            data = qp.P.data.copy()
            data[place] = np.nan
            qp = replace(qp, P=Csc((len(qp.q), len(qp.q)), data, qp.P.indices, qp.P.indptr))
        else:
            values = getattr(qp, what).copy()
            values[place] = np.nan
            qp = replace(qp, **{what: values})
        assert active_set.solve(given._replace(qp=qp), platoon.blocks, PLAY_MPS) is None
