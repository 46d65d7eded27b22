"""The paper's program: the reduction loses nothing, and the sweep finds the largest feasible speeds."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from gameopt_im.core import program
from gameopt_im.core.conflicts import PAPER_GROUPS
from gameopt_im.core.program import Rows, Traffic
from gameopt_im.core.snapshot import Bools, Floats
from gameopt_im.solver.workspace import Workspace, pattern

DT_S, M_SR, M_SL, LAMBDA = 0.1, 2.0, 25.0, 0.7
GROUPS = [f"{road}-{way}" for road in range(4) for way in range(3)]
CONFLICT: NDArray[np.bool_] = np.array(
    [[a in PAPER_GROUPS and b in PAPER_GROUPS and a != b and b not in PAPER_GROUPS[a] for b in GROUPS] for a in GROUPS]
)


@st.composite
def platoon(draw: st.DrawFn) -> Traffic:
    """Up to ten vehicles in the order they should cross, spread so that about every other state is feasible.

    The first may be inside the conflict zone or through it.
    """
    n = draw(st.integers(2, 10))
    numbers = st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n).map(np.array)
    gap, speed, reach, weight = (draw(numbers) for _ in range(4))
    movement = np.array(draw(st.lists(st.integers(0, 11), min_size=n, max_size=n)))
    return Traffic(
        s=np.cumsum(8.0 + 40.0 * gap) - draw(st.sampled_from([0.0, 12.0, 45.0])),
        v=10.0 + 3.0 * speed,
        length=np.where(gap > 0.8, 12.0, 5.0),
        a_max=1.0 + 2.0 * reach,
        b_max=3.0 + 2.0 * reach,
        v_max=np.full(n, 20.0),
        speed_priority=0.8 + weight,
        variation_priority=2.0 - weight,
        movement=movement,
        lane=movement,
    )


def rows_of(vehicles: Traffic, *, reduced: bool) -> Rows:
    order = np.arange(len(vehicles))
    lateral = program.lateral_rows(vehicles, order, CONFLICT, M_SL, DT_S, reduced=reduced)
    return program.join(program.rear_end_rows(vehicles, M_SR, DT_S), lateral)


def largest(vehicles: Traffic, rows: Rows) -> Floats | None:
    z = vehicles.s - 0.5 * DT_S * vehicles.v
    order = np.argsort(z > 0.0, kind="stable")
    return program.largest_feasible(*program.boxes(vehicles, DT_S), rows, order)


def solved(vehicles: Traffic, *, reduced: bool, elastic: bool) -> Floats:
    lateral = program.lateral_rows(vehicles, np.arange(len(vehicles)), CONFLICT, M_SL, DT_S, reduced=reduced)
    rear_end = program.rear_end_rows(vehicles, M_SR, DT_S)
    qp = program.assemble(vehicles, LAMBDA, DT_S, rear_end, lateral, elastic=elastic)
    workspace = Workspace(residual_mps=1e-5, max_iter=100_000, rho=100.0 if elastic else 10.0)
    solution = workspace.solve(pattern(qp), qp)
    assert solution is not None
    return solution.x[: len(vehicles)]


def reaches(before: Bools) -> Bools:
    """Reachability by plain iteration."""
    reach = before.copy()
    for _ in before:
        reach = reach | (reach @ before)
    return reach


@given(platoon())
def test_reduced_and_full_rows_have_the_same_largest_point(vehicles: Traffic) -> None:
    full, reduced = (largest(vehicles, rows_of(vehicles, reduced=reduced)) for reduced in (False, True))
    assert (full is None) == (reduced is None)
    if full is not None and reduced is not None:
        np.testing.assert_allclose(full, reduced, atol=1e-9)


@settings(max_examples=40)
@given(platoon())
def test_reduced_full_and_elastic_rows_have_one_solution_on_feasible_states(vehicles: Traffic) -> None:
    assume(largest(vehicles, rows_of(vehicles, reduced=False)) is not None)
    full = solved(vehicles, reduced=False, elastic=False)
    np.testing.assert_allclose(solved(vehicles, reduced=True, elastic=False), full, atol=2e-4)
    np.testing.assert_allclose(solved(vehicles, reduced=True, elastic=True), full, atol=2e-3)


@given(platoon())
def test_any_speeds_that_meet_the_reduced_rows_meet_the_full_ones(vehicles: Traffic) -> None:
    """On any state, feasible within the boxes or not: the rows alone imply each other for u >= 0."""
    reduced, full = rows_of(vehicles, reduced=True), rows_of(vehicles, reduced=False)
    assert len(reduced) <= len(full)
    z = vehicles.s - 0.5 * DT_S * vehicles.v
    order = np.argsort(z > 0.0, kind="stable")
    rng = np.random.default_rng(len(vehicles))
    for top in rng.uniform(0.0, 20.0, (5, len(vehicles))):
        met = program.largest_feasible(np.full(len(vehicles), -np.inf), top, reduced, order)
        assert met is not None
        if met.min() >= 0.0:
            assert program.violations(full, met).max(initial=0.0) <= 1e-9


@given(platoon(), st.booleans())
def test_the_sweep_agrees_with_a_linear_program(vehicles: Traffic, reduced: bool) -> None:
    rows = rows_of(vehicles, reduced=reduced)
    lower, upper = program.boxes(vehicles, DT_S)
    n, m = len(vehicles), len(rows)
    index = np.arange(m)
    matrix = csr_matrix(
        (
            np.concatenate([rows.c_target, -rows.c_source]),
            (np.concatenate([index, index]), np.concatenate([rows.target, rows.source])),
        ),
        shape=(m, n),
    )
    best = linprog(-np.ones(n), A_ub=matrix, b_ub=rows.bound, bounds=np.stack([lower, upper], axis=1))
    found = largest(vehicles, rows)
    # Within the linear program's own tolerance either answer is right.
    slack = largest(vehicles, Rows(*(getattr(rows, f) for f in ROW_FIELDS[:-1]), bound=rows.bound + 1e-6))
    if found is not None:
        assert best.status == 0
        np.testing.assert_allclose(best.x, found, atol=1e-4)
    elif slack is None:
        assert best.status == 2


ROW_FIELDS = ("source", "target", "c_source", "c_target", "bound")


@given(st.integers(1, 14), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_the_reduction_is_the_least_relation_with_the_same_reachability(n: int, density: float, seed: int) -> None:
    before = np.triu(np.random.default_rng(seed).random((n, n)) < density, k=1)
    kept = program.transitive_reduction(before)
    assert not (kept & ~before).any()
    np.testing.assert_array_equal(reaches(kept), reaches(before))
    for i, j in np.argwhere(kept):
        without = kept.copy()
        without[i, j] = False
        assert not reaches(without)[i, j]
