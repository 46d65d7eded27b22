"""The horizon program: its cost against the sum it stands for, its rows against the ways they bound."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.sparse import csc_matrix

from gameopt_im.core import horizon
from gameopt_im.core.corridor import SLACK_MPS, corridor, reference
from gameopt_im.core.horizon import LONGEST, HorizonRules, HorizonTask, platoons
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.core.program import Sparse
from gameopt_im.core.residuals import residual
from gameopt_im.core.snapshot import Floats

BLOCKS = (0.5, 0.5, 1.0)
ENDS = np.cumsum(BLOCKS)
H = len(BLOCKS)
MANNER = Manner(decels=(1.0, 1.5, 2.25, 3.4), slowest=0.5, line_share=0.9)
RULES = HorizonRules(blocks=BLOCKS, trade_off=0.7, rear_gap=2.0, manner=MANNER)
SLOTS = np.array([6.0, 9.0, 7.0])
TASK = HorizonTask(
    counts=(2, 1),
    s=np.array([60.0, 80.0, 70.0]),
    v=np.array([10.0, 10.0, 12.0]),
    length=np.array([5.0, 5.0, 12.0]),
    a=np.array([2.0, 2.0, 1.0]),
    b=np.array([4.5, 4.5, 4.0]),
    top=np.array([20.0, 18.0, 15.0]),
    line_cap=np.array([20.0, 18.0, 9.0]),
    ps=np.array([1.0, 5.0, 0.8]),
    pv=np.array([1.0, 0.5, 2.5]),
    room=np.full((3, H), NEVER),
    trails=np.zeros(3, dtype=np.bool_),
)
CORRIDOR, SPEED, CHANGE, REAR_END = range(4)


def dense(matrix: Sparse) -> Floats:
    return csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape).toarray()


class Built(NamedTuple):
    """All lanes of a candidate side by side; `A`, `l` and `u` by the kind of row, a row a vehicle and block."""

    P: Floats
    q: Floats
    A: list[Floats]
    l: list[Floats]  # noqa: E741
    u: list[Floats]
    reference: Floats


def built(task: HorizonTask = TASK, slots: Floats = SLOTS) -> Built:
    whole, ends = horizon.build(task, RULES, slots), np.cumsum(task.counts)
    parts = [whole[end - m : end] for m, end in zip(task.counts, ends, strict=True)]
    lanes = [horizon.program(part, BLOCKS)[:2] for part in parts]  # without a start given, that is the reference
    assert [len(reference) for _, reference in lanes] == [count * H for count in task.counts]
    P, A = (
        block_diag(*(dense(matrix) for matrix in one)) for one in zip(*((qp.P, qp.A) for qp, _ in lanes), strict=True)
    )
    kind = np.concatenate([np.repeat([0, 1, 2, 3], np.array([m, m, m, m - 1]) * H) for m in task.counts])
    rows = [np.flatnonzero(kind == each) for each in range(4)]
    l, u = (np.concatenate(bound) for bound in zip(*((qp.l, qp.u) for qp, _ in lanes), strict=True))  # noqa: E741
    return Built(
        P, np.concatenate([qp.q for qp, _ in lanes]), [A[r] for r in rows], [l[r] for r in rows], [u[r] for r in rows],
        np.concatenate([reference for _, reference in lanes]),
    )  # fmt: skip


def ways(task: HorizonTask, u: Floats) -> Floats:
    """(n, H) ways by the ends of the blocks, one trapezium after the other."""
    speeds = np.column_stack([task.v, u.reshape(len(task.s), H)])
    return np.cumsum(0.5 * (speeds[:, 1:] + speeds[:, :-1]) * BLOCKS, axis=1)


def cost(u: Floats) -> float:
    """`eq:J2` summed block by block."""
    total = 0.0
    for i, speeds in enumerate(u.reshape(3, H)):
        before = TASK.v[i]
        for speed in speeds:
            total += 0.7 * TASK.ps[i] * (speed - TASK.top[i]) ** 2 + 0.3 * TASK.pv[i] * (speed - before) ** 2
            before = speed
    return total


def test_the_cost_is_the_sum_of_the_papers_up_to_a_constant() -> None:
    qp = built()
    upper = qp.P
    both = upper + np.triu(upper, 1).T
    constant = cost(np.zeros(3 * H))
    for u in np.random.default_rng(1).uniform(0.0, 20.0, (5, 3 * H)):
        assert 0.5 * u @ both @ u + qp.q @ u + constant == pytest.approx(cost(u))
        assert horizon.objective(TASK, RULES, u) == pytest.approx(cost(u))


@pytest.mark.parametrize("shift", [-3.0, 0.0, 5.0])
def test_the_reference_is_inside_with_play_to_spare(shift: float) -> None:
    qp = built(slots=SLOTS + shift)
    for kind in (CORRIDOR, SPEED, CHANGE, REAR_END):
        at = qp.A[kind] @ qp.reference
        spare = SLACK_MPS if kind in (CORRIDOR, CHANGE) else 0.0
        assert (at - qp.l[kind] >= spare - 1e-9).all()
        assert (qp.u[kind] - at >= spare - 1e-9).all()


def test_the_rows_are_ways_speeds_and_changes() -> None:
    qp = built()
    assert [len(rows) for rows in qp.A] == [3 * H, 3 * H, 3 * H, H]
    u = np.random.default_rng(2).uniform(0.0, 20.0, 3 * H)
    at = [rows @ u for rows in qp.A]
    way = ways(TASK, u) - 0.5 * BLOCKS[0] * TASK.v[:, None]
    np.testing.assert_allclose(at[CORRIDOR].reshape(3, H), way / ENDS)
    np.testing.assert_allclose(at[SPEED], u)
    np.testing.assert_allclose(at[CHANGE].reshape(3, H), np.diff(u.reshape(3, H), axis=1, prepend=0.0))
    np.testing.assert_allclose(at[REAR_END], (way[1] - way[0]) / ENDS)


def test_the_corridor_by_hand() -> None:
    # 2 s before its slot, at 10 m/s over the line: at most 2 * 10 - 2 * 2^2 / 2 = 16 m to go; at least, from 20 m/s
    # braked at 3 m/s^2, 2 * 10 + 3 * 2^2 / 2 = 26 m.
    least, most = corridor(60.0, 2.0, 4.5, 20.0, slot=5.0, line=10.0, end=3.0)
    assert (least, most) == (pytest.approx(60.0 - 26.0), pytest.approx(60.0 - 16.0))
    least, most = corridor(60.0, 2.0, 4.5, 20.0, slot=5.0, line=10.0, end=6.0)
    assert (least, most) == (pytest.approx(60.0 + 10.0), NEVER)


def test_the_corridor_bounds_the_way_of_the_program() -> None:
    qp = built()
    t = TASK
    line = reference(t.s, t.v, SLOTS, t.a, t.b, t.top, t.line_cap, MANNER, np.array(BLOCKS))[1]
    both = [
        [corridor(t.s[i], t.a[i], t.b[i], t.top[i], SLOTS[i], line[i], end) for end in ENDS] for i in range(len(t.s))
    ]
    least, most = np.moveaxis(np.array(both), 2, 0)
    start, way = 0.5 * BLOCKS[0] * TASK.v[:, None], ways(TASK, qp.reference)
    assert np.count_nonzero(least < way) > H
    assert np.count_nonzero(way < most) > H
    low = (np.minimum(least, way) - start) / ENDS - SLACK_MPS  # widened to hold the reference
    high = (np.maximum(most, way) - start) / ENDS + SLACK_MPS
    np.testing.assert_allclose(qp.l[CORRIDOR].reshape(3, H), low)
    np.testing.assert_allclose(qp.u[CORRIDOR].reshape(3, H), high)


def test_a_cleared_leader_leaves_less_room() -> None:
    free = built().u[CORRIDOR]
    room = TASK.room.copy()
    room[2] = [7.0, 14.0, 27.0]
    tight = built(replace(TASK, room=room)).u[CORRIDOR]
    np.testing.assert_allclose(tight[2 * H :], (room[2] - 3.0) / ENDS + SLACK_MPS)
    assert (tight[2 * H :] < free[2 * H :]).all()
    np.testing.assert_array_equal(tight[: 2 * H], free[: 2 * H])


def test_the_boxes_are_limits_and_reach() -> None:
    qp = built()
    assert (qp.l[SPEED] == 0.0).all()
    np.testing.assert_allclose(qp.u[SPEED], np.repeat(TASK.top, H))
    now = np.column_stack([TASK.v, np.zeros((3, H - 1))])
    np.testing.assert_allclose(qp.u[CHANGE].reshape(3, H), now + TASK.a[:, None] * BLOCKS + SLACK_MPS)
    assert (qp.l[CHANGE].reshape(3, H) <= now - 1.5 * np.array(BLOCKS) - SLACK_MPS + 1e-9).all()
    assert (qp.l[CHANGE].reshape(3, H) >= now - 3.4 * np.array(BLOCKS) - SLACK_MPS - 1e-9).all()


def test_a_follower_keeps_its_distance() -> None:
    qp = built()
    np.testing.assert_allclose(qp.u[REAR_END], 13.0 / ENDS + SLACK_MPS)  # 20 m less its length and 2 m; same speed
    assert np.isneginf(qp.l[REAR_END]).all()
    back = replace(TASK, s=TASK.s + np.array([4.0, 0.0, 0.0]))
    np.testing.assert_allclose(built(back).u[REAR_END], 9.0 / ENDS + SLACK_MPS)


def test_the_first_speed_is_on_the_way_to_the_first_blocks_end() -> None:
    u = np.repeat(np.array([15.0, 5.0, 12.0]), H)
    np.testing.assert_allclose(horizon.first_speeds(TASK, RULES, u), [11.0, 9.0, 12.0])


def test_long_lanes_are_cut_into_platoons_alike_in_length() -> None:
    counts, trails = platoons([LONGEST, 2 * LONGEST + 1, 1])
    assert counts == (LONGEST, 7, 7, 7, 1)
    assert np.flatnonzero(trails).tolist() == [LONGEST + 7, LONGEST + 14]
    assert platoons([])[0] == ()


def test_who_heads_a_later_platoon_stays_behind_the_reference_of_the_one_ahead() -> None:
    cut = replace(TASK, counts=(1, 1, 1), trails=np.array([False, True, False]))
    qp, near = built(cut), built(replace(cut, s=TASK.s - np.array([0.0, 12.0, 0.0])))
    ahead = ways(TASK, qp.reference)[0] - 0.5 * BLOCKS[0] * TASK.v[1]
    for made, gap in ((qp, 13.0), (near, 1.0)):  # 20 m, 8 m less its length and 2 m
        own = ways(TASK, made.reference)[1] - 0.5 * BLOCKS[0] * TASK.v[1]
        bound = np.maximum(ahead + gap, own) / ENDS + SLACK_MPS
        assert (made.u[CORRIDOR].reshape(3, H)[1] <= bound + 1e-9).all()
    assert (near.u[CORRIDOR].reshape(3, H)[1] < qp.u[CORRIDOR].reshape(3, H)[1]).any()


@pytest.mark.parametrize("kind", [CORRIDOR, SPEED, CHANGE, REAR_END])
def test_a_violation_is_the_largest_of_any_row(kind: int) -> None:
    """Of random speeds, against the rows as a matrix: with the bounds of one kind alone, so that each has its turn."""
    random, values = np.random.default_rng(3), horizon.build(TASK, RULES, SLOTS)[: TASK.counts[0]]
    for other in {CORRIDOR, SPEED, CHANGE, REAR_END} - {kind}:
        for k in range(H):
            column = horizon.column_of(H, other, k)
            values[:, column], values[:, column + horizon.BOUND * H] = -1e9, 1e9
    qp, _ = horizon.program(values, BLOCKS)
    tried = random.uniform(-30.0, 60.0, (20, len(values), H))
    found = [horizon.violation(values, u, horizon.mean_speeds(BLOCKS)) for u in tried]
    assert found == pytest.approx([residual(qp, u.ravel()) for u in tried])
    assert max(found) > 0.0
