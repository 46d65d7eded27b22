"""The paper's program: every row against the inequality it stands for, the objective against its formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import CONFLICT, paper_program, random_traffic, traffic
from scipy.sparse import csc_matrix

from gameopt_im.core import program
from gameopt_im.core.program import Rows, Sparse, Traffic, csc
from gameopt_im.core.snapshot import Floats, Ints, Snapshot

DT_S, M_SR, M_SL = 0.1, 2.0, 25.0


def dense(matrix: Sparse) -> Floats:
    return csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape).toarray()


def lateral(vehicles: Traffic, *order: int, reduced: bool = False) -> set[tuple[int, int]]:
    rows = program.lateral_rows(vehicles, np.array(order, dtype=np.int64), CONFLICT, M_SL, DT_S, reduced=reduced)
    return set(zip(rows.source.tolist(), rows.target.tolist(), strict=True))


def cost(vehicles: Traffic, trade_off: float, u: Floats) -> float:
    go, steady = trade_off * vehicles.speed_priority, (1 - trade_off) * vehicles.variation_priority
    return float(np.sum(go * (u - vehicles.v_max) ** 2 + steady * (u - vehicles.v) ** 2))


def test_the_objective_is_that_of_the_paper() -> None:
    vehicles, _ = random_traffic(9, seed=1)
    diagonal, q, constant = program.objective(vehicles, 0.7)
    for u in np.random.default_rng(3).uniform(0.0, 20.0, (5, 9)):
        assert 0.5 * u @ (diagonal * u) + q @ u + constant == pytest.approx(cost(vehicles, 0.7, u))


def test_without_priorities_it_is_the_objective_of_the_first_paper() -> None:
    vehicles = traffic(s=[50.0, 60.0], v=[10.0, 5.0])
    diagonal, q, constant = program.objective(vehicles, 0.7)
    u = np.array([12.0, 3.0])
    wanted = 0.7 * ((12 - 20) ** 2 + (3 - 20) ** 2) + 0.3 * ((12 - 10) ** 2 + (3 - 5) ** 2)
    assert 0.5 * u @ (diagonal * u) + q @ u + constant == pytest.approx(wanted)


def test_boxes_are_the_tighter_of_limit_and_reach() -> None:
    vehicles = traffic(s=[50.0] * 4, v=[10.0, 0.2, 19.9, 25.0], a_max=[2.0] * 4, b_max=[4.0] * 4)
    lower, upper = program.boxes(vehicles, DT_S)
    np.testing.assert_allclose(lower, [9.6, 0.0, 19.5, 24.6])
    np.testing.assert_allclose(upper, [10.2, 0.4, 20.0, 24.6])  # too fast to obey: brakes as hard as it can


def test_rear_end_rows_hold_where_the_gap_does() -> None:
    vehicles = traffic(s=[32.5, 10.0, 18.0], v=[12.0, 8.0, 10.0], length=[5.0, 5.0, 12.0], lane=[4, 4, 4])
    rows = program.rear_end_rows(vehicles, M_SR, DT_S)
    assert list(zip(rows.source.tolist(), rows.target.tolist(), strict=True)) == [(1, 2), (2, 0)]
    np.testing.assert_allclose(np.hypot(rows.c_source, rows.c_target), 1.0)
    met = set()
    for u in np.random.default_rng(4).uniform(0.0, [60.0, 40.0, 40.0], (400, 3)):
        after = vehicles.s - DT_S * (vehicles.v + u) / 2  # eq:eq_cons_3_1
        gap = after[rows.target] - after[rows.source] - vehicles.length[rows.source] - M_SR
        holds = program.violations(rows, u) <= 0
        np.testing.assert_array_equal(holds, gap >= 0)
        met.update(enumerate(holds.tolist()))
    assert len(met) == 4  # each row was met and broken


def test_vehicles_that_part_ways_are_held_together_only_on_their_lane() -> None:
    def rows(s: float, movement: int) -> int:
        vehicles = traffic(s=[s, 20.0], movement=[1, movement], lane=[1, 1])
        return len(program.rear_end_rows(vehicles, M_SR, DT_S))

    assert (rows(-4.9, 2), rows(-5.1, 2), rows(-5.1, 1)) == (1, 0, 1)


def test_lateral_rows_hold_where_the_first_is_through_in_time() -> None:
    vehicles = traffic(s=[20.0, 60.0], v=[10.0, 15.0], length=[5.0, 12.0], movement=[1, 7])
    rows = program.lateral_rows(vehicles, np.array([0, 1]), CONFLICT, M_SL, DT_S, reduced=False)
    np.testing.assert_allclose(np.hypot(rows.c_source, rows.c_target), 1.0)
    met = set()
    for u in np.random.default_rng(6).uniform(0.1, 20.0, (200, 2)):
        z = vehicles.s - DT_S / 2 * vehicles.v
        through = (z[0] + 5.0 + M_SL) / u[0] <= z[1] / u[1]
        holds = bool(program.violations(rows, u)[0] <= 0)
        assert holds == through
        met.add(holds)
    assert met == {True, False}


def test_every_conflicting_pair_has_a_row_in_the_order_of_the_sequence() -> None:
    vehicles = traffic(s=[20.0, 30.0, 40.0, 50.0], movement=[1, 7, 2, 0])  # 0-1, 2-1, 0-2, 0-0
    assert lateral(vehicles, 0, 1, 2, 3) == {(0, 1), (1, 2)}
    assert lateral(vehicles, 2, 3, 1, 0) == {(2, 1), (1, 0)}


def test_who_is_inside_goes_first_and_who_has_cleared_binds_nobody() -> None:
    inside = traffic(s=[40.0, 0.4], movement=[1, 7])
    assert lateral(inside, 0, 1) == {(1, 0)}  # at 10 m/s it passes the line in this very step
    assert lateral(traffic(s=[-3.0, -0.1], movement=[1, 7]), 0, 1) == set()
    gone = 0.5 - 5.0 - M_SL  # z + l + M_sl = 0
    assert lateral(traffic(s=[gone + 0.01, 40.0], movement=[1, 7]), 0, 1) == {(0, 1)}
    assert lateral(traffic(s=[gone - 0.01, 40.0], movement=[1, 7]), 0, 1) == set()


def test_the_reduction_keeps_the_row_of_a_follower() -> None:
    vehicles = traffic(s=[20.0, 30.0, 45.0, 50.0], movement=[1, 7, 7, 10], lane=[1, 7, 7, 10])
    # 0-1 before 2-1, its follower, and 3-1, which conflicts with 0-1 only.
    assert lateral(vehicles, 0, 1, 2, 3) == {(0, 1), (0, 2), (0, 3)}
    assert lateral(vehicles, 0, 1, 2, 3, reduced=True) == {(0, 1), (0, 2), (0, 3)}


def test_the_reduction_drops_what_a_chain_implies() -> None:
    each = traffic(s=[20.0, 30.0, 40.0], movement=[1, 7, 11])  # 0-1, 2-1, 3-2: each conflicts with each
    assert lateral(each, 0, 1, 2) == {(0, 1), (0, 2), (1, 2)}
    assert lateral(each, 0, 1, 2, reduced=True) == {(0, 1), (1, 2)}
    # 0-1, 2-1, 1-1, 3-1: the second and the last do not conflict, and still the chain of all implies (0, 3).
    chain = traffic(s=[20.0, 30.0, 40.0, 50.0], movement=[1, 7, 4, 10])
    assert lateral(chain, 0, 1, 2, 3) == {(0, 1), (0, 3), (1, 2), (2, 3)}
    assert lateral(chain, 0, 1, 2, 3, reduced=True) == {(0, 1), (1, 2), (2, 3)}


def test_no_chain_runs_through_a_vehicle_inside() -> None:
    before = np.zeros((3, 3), dtype=np.bool_)
    before[0, 1] = before[1, 2] = before[0, 2] = True
    kept = program.transitive_reduction(before)
    assert np.argwhere(kept).tolist() == [[0, 1], [1, 2]]
    before[0, 1] = False  # 1 is inside: nobody goes before it
    np.testing.assert_array_equal(program.transitive_reduction(before), before)


def test_the_elastic_program_laid_out() -> None:
    vehicles = traffic(s=[10.0, 18.0, 40.0], movement=[1, 1, 7], lane=[1, 1, 7])
    order = np.array([0, 1, 2])
    qp, hard = paper_program(vehicles, order), paper_program(vehicles, order, elastic=False)
    rows = dense(hard.A)[3:]
    assert dense(hard.A)[:3].tolist() == np.eye(3).tolist()
    assert hard.A.shape == (3 + 3, 3)
    wanted = np.block([[np.eye(3), np.zeros((3, 3))], [rows, -np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    np.testing.assert_array_equal(dense(qp.A), wanted)
    assert np.diag(dense(qp.P))[3:].tolist() == [20.0, 20.0, 20.0]
    assert qp.q[3:].tolist() == [3000.0, 300.0, 300.0]  # the rear-end row gives way last
    assert qp.l[6:].tolist() == [0.0] * 3
    assert np.isinf(qp.u[6:]).all()
    np.testing.assert_array_equal(qp.u[:6], hard.u)


def test_the_pattern_does_not_depend_on_values() -> None:
    vehicles, _ = random_traffic(12, seed=2)
    still = replace(vehicles, v=np.zeros(12))
    rows = [program.rear_end_rows(each, M_SR, DT_S) for each in (vehicles, still)]
    made = [program.assemble(vehicles, 0.7, DT_S, each, each) for each in rows]
    np.testing.assert_array_equal(made[0].A.indices, made[1].A.indices)
    np.testing.assert_array_equal(made[0].A.indptr, made[1].A.indptr)


def test_csc_keeps_stored_zeros() -> None:
    made = csc((2, 3), np.array([1, 0, 0]), np.array([2, 2, 0]), np.array([5.0, 0.0, 7.0]))
    assert made.data.tolist() == [7.0, 0.0, 5.0]
    assert made.indptr.tolist() == [0, 1, 1, 3]
    np.testing.assert_array_equal(dense(made), [[7.0, 0.0, 0.0], [0.0, 0.0, 5.0]])


def test_traffic_is_read_off_the_snapshot() -> None:
    fields = {name: np.arange(4.0) for name in Snapshot.__dataclass_fields__}
    snapshot = Snapshot(**(fields | {"ids": ("a", "b", "c", "d")}))  # type: ignore[arg-type]
    assert len(program.traffic(snapshot)) == 4
    assert program.traffic(snapshot, np.array([2, 0])).s.tolist() == [2.0, 0.0]


def rows_of(*rows: tuple[int, int, float, float, float]) -> Rows:
    source, target, c_source, c_target, bound = (np.array(column) for column in zip(*rows, strict=True))
    return Rows(source, target, c_source, c_target, bound)


def test_the_largest_feasible_speeds_by_one_sweep() -> None:
    rows = rows_of((0, 2, 1.0, 2.0, 0.0), (2, 1, 1.0, 1.0, -1.0))
    order: Ints = np.array([0, 2, 1])
    lower, upper = np.zeros(3), np.array([10.0, 9.0, 8.0])
    found = program.largest_feasible(lower, upper, rows, order)
    assert found is not None
    assert found.tolist() == [10.0, 4.0, 5.0]
    assert program.largest_feasible(np.array([0.0, 4.1, 0.0]), upper, rows, order) is None
    with pytest.raises(ValueError, match="after its target"):
        program.largest_feasible(lower, upper, rows, np.array([0, 1, 2]))
