"""OSQP workspaces: a solution or none by our own residual, and no memory of what was solved before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import paper_program, random_traffic, traffic
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core.program import QP, csc, diagonal
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.solution import Solution
from gameopt_im.solver.workspace import Workspace, pattern


def box(target: Floats, low: float, high: float) -> QP:
    """min |x - target|^2 within [low, high]."""
    n = len(target)
    return QP(
        P=diagonal(np.full(n, 2.0)),
        q=-2.0 * target,
        A=diagonal(np.ones(n)),
        l=np.full(n, low),
        u=np.full(n, high),
        constant=float(target @ target),
    )


def bits(solution: Solution | None) -> tuple[bytes, bytes, float, int] | None:
    if solution is None:
        return None
    return solution.x.tobytes(), solution.y.tobytes(), solution.residual, solution.iterations


def solved(workspace: Workspace, qp: QP, start: Floats | None = None) -> Solution:
    solution = workspace.solve(pattern(qp), qp, start)
    assert solution is not None
    return solution


def test_a_solution_with_its_objective_and_residual() -> None:
    qp = box(np.array([3.0, -1.0, 0.5]), 0.0, 1.0)
    solution = solved(Workspace(), qp)
    np.testing.assert_allclose(solution.x, [1.0, 0.0, 0.5], atol=1e-3)
    assert objective(qp, solution.x) == pytest.approx(4.0 + 1.0, abs=1e-2)
    assert solution.residual <= 1e-3
    assert solution.iterations > 0


def test_entries_off_the_diagonal_of_p_count_twice() -> None:
    p = csc((2, 2), np.array([0, 0, 1]), np.array([0, 1, 1]), np.array([2.0, 1.0, 2.0]))
    qp = QP(p, np.array([-4.0, -5.0]), diagonal(np.ones(2)), np.full(2, -9.0), np.full(2, 9.0), 7.0)
    solution = solved(Workspace(residual_mps=1e-6), qp)
    np.testing.assert_allclose(solution.x, [1.0, 2.0], atol=1e-3)
    x = np.array([1.0, 2.0])
    full = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert objective(qp, solution.x) == pytest.approx(0.5 * x @ full @ x + qp.q @ x + 7.0, abs=1e-4)


def test_rows_of_any_length_give_the_same_solution_and_residual() -> None:
    long_rows = csc((2, 2), np.array([0, 1]), np.array([0, 1]), np.array([1e-2, 1e2]))
    qp = QP(diagonal(np.full(2, 2.0)), np.array([-6.0, -6.0]), long_rows, np.zeros(2), np.array([1e-2, 1e2]))
    solution = Workspace(rho=1.0).solve(pattern(qp), qp, lengths=np.ones(2))
    assert solution is not None
    np.testing.assert_allclose(solution.x, [1.0, 1.0], atol=1e-4)
    ax = np.array([1e-2, 1e2]) * solution.x
    assert solution.residual == pytest.approx(np.max(np.maximum(-ax, ax - qp.u), initial=0.0))


def test_what_is_infeasible_has_no_solution() -> None:
    workspace = Workspace()
    qp = box(np.zeros(2), 0.0, 1.0)
    assert workspace.solve("crossed", replace(qp, l=np.full(2, 2.0))) is None
    twice = csc((2, 1), np.array([0, 1]), np.array([0, 0]), np.ones(2))
    apart = QP(diagonal(np.ones(1)), np.zeros(1), twice, np.array([0.0, 2.0]), np.array([1.0, 3.0]))
    assert workspace.solve("apart", apart) is None


def test_an_unfinished_solve_is_no_solution() -> None:
    vehicles, order = random_traffic(30, seed=4)
    qp = paper_program(vehicles, order)
    assert Workspace(max_iter=25).solve(pattern(qp), qp) is None
    assert Workspace().solve(pattern(qp), qp) is not None


def test_one_key_is_one_pattern() -> None:
    workspace = Workspace()
    workspace.solve("key", box(np.zeros(2), 0.0, 1.0))
    with pytest.raises(ValueError, match="another sparsity pattern"):
        workspace.solve("key", box(np.zeros(3), 0.0, 1.0))


def test_patterns_differ_where_programs_do() -> None:
    crossing, alone = traffic(s=[20.0, 40.0], movement=[1, 7]), traffic(s=[20.0, 40.0], movement=[1, 4])
    order = np.array([0, 1])
    a, b = paper_program(crossing, order), paper_program(alone, order)
    assert pattern(a) != pattern(b)
    assert pattern(a) == pattern(paper_program(replace(crossing, s=np.array([30.0, 35.0])), order))


def drawn(seed: int, kind: int) -> tuple[QP, Floats | None]:
    """A program of one of three patterns; values, bounds (some open, some equal) and start by `seed`.

    Every fifth is infeasible: what a solver is left with after one must not show either.
    """
    rng = np.random.default_rng([seed, kind])
    n, m = 6 + kind, 9
    row, column = np.nonzero(np.random.default_rng(kind).random((m, n)) < 0.4)
    A = csc((m, n), row, column, rng.normal(size=len(row)))
    inside = np.bincount(row, rng.normal(size=len(row)), m)
    l, u = inside - rng.random(m), inside + rng.random(m)  # noqa: E741
    l[rng.integers(m)] = -np.inf
    u[rng.integers(m)] = np.inf
    same = rng.integers(m)
    l[same] = u[same] = 0.0 if np.isinf(u[same]) else u[same]
    if seed % 5 == 0:
        u[:3], l[:3] = -50.0, -60.0
    qp = QP(diagonal(rng.uniform(0.5, 3.0, n)), 5.0 * rng.normal(size=n), A, l, u)
    return qp, None if seed % 3 == 0 else rng.normal(size=n)


draws = st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 2)), min_size=1, max_size=12)


@settings(max_examples=60)
@given(draws, st.integers(1, 3), st.booleans(), st.booleans())
def test_results_are_the_same_bits_whatever_was_solved_before(
    history: list[tuple[int, int]], capacity: int, scaled: bool, again: bool
) -> None:
    lived = Workspace(rho=1.0, max_iter=400, residual_mps=1e-2, capacity=capacity)
    lengths = np.linspace(0.5, 1.5, 9) if scaled else None
    for seed, kind in history:
        qp, start = drawn(seed, kind)
        expected = bits(Workspace(rho=1.0, max_iter=400, residual_mps=1e-2).solve(kind, qp, start, lengths))
        for program in (qp, replace(qp, q=qp.q + 0.0))[: 1 + again]:  # the second time its matrices are known
            assert bits(lived.solve(kind, program, start, lengths)) == expected


def test_the_papers_program_has_no_memory_either() -> None:
    lived = Workspace()
    vehicles, order = random_traffic(25, seed=8)
    found = []
    for step in range(12):
        moved = replace(vehicles, s=vehicles.s - 0.2 * step, v=np.maximum(vehicles.v - 0.3 * step, 0.0))
        qp = paper_program(moved, order)
        result = bits(lived.solve(pattern(qp), qp))
        assert result == bits(Workspace().solve(pattern(qp), qp))
        found.append(result)
    assert len(set(found)) == 12
    assert None not in found
