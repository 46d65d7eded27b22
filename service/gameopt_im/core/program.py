"""The paper's program: one step of speeds for a given sequence, as data for a solver.

Building is pure; `gameopt_im.solver` solves. Every rear-end and lateral row has the form
c_target u[target] - c_source u[source] <= bound with positive coefficients, that is u_j <= f(u_i) with f
increasing, and is scaled to coefficients of norm 1: what it is violated by is m/s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gameopt_im.core.snapshot import Bools, Floats, Ints, Snapshot

LATERAL_PENALTY = (300.0, 10.0)
"""Linear (1/(m/s)) and quadratic (1/(m/s)^2) weight of a lateral row's slack in the elastic program."""
REAR_END_PENALTY = (3000.0, 10.0)
"""The same for a rear-end row: it gives way last.

Above the multipliers of feasible states (80 at most in 363 random ones), so slack is used only where nothing
else is left; far above them the solver needs several times the iterations.
"""


class Sparse(Protocol):
    """A matrix by columns: what both `Csc` and scipy's csc matrices offer."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def data(self) -> Floats: ...
    @property
    def indices(self) -> Ints: ...
    @property
    def indptr(self) -> Ints: ...


@dataclass(frozen=True, slots=True)
class Csc:
    """A sparse matrix by columns; zeros that are stored are kept, so a pattern does not depend on values."""

    shape: tuple[int, int]
    data: Floats
    indices: Ints
    indptr: Ints


def csc(shape: tuple[int, int], row: Ints, column: Ints, value: Floats) -> Csc:
    """The matrix of the entries (row, column, value), each place named at most once."""
    order = np.lexsort((row, column))
    indptr = np.zeros(shape[1] + 1, dtype=np.int64)
    np.cumsum(np.bincount(column, minlength=shape[1]), out=indptr[1:])
    return Csc(shape, value[order], row[order], indptr)


def diagonal(value: Floats) -> Csc:
    """The square matrix with this diagonal."""
    n = len(value)
    return Csc((n, n), value, np.arange(n), np.arange(n + 1))


@dataclass(frozen=True, slots=True)
class QP:
    """min 1/2 x'Px + q'x + constant over l <= Ax <= u, with P (nx, nx) upper triangular and A (m, nx)."""

    P: Sparse
    q: Floats
    A: Sparse
    l: Floats  # noqa: E741 - the programs' own name
    u: Floats
    constant: float = 0.0


@dataclass(frozen=True, slots=True)
class Traffic:
    """The n vehicles of a program; the fields are those of `Snapshot`, in m, m/s, m/s^2."""

    s: Floats
    v: Floats
    length: Floats
    a_max: Floats
    b_max: Floats
    v_max: Floats
    speed_priority: Floats
    variation_priority: Floats
    movement: Ints
    lane: Ints

    def __len__(self) -> int:
        return len(self.s)


def traffic(snapshot: Snapshot, members: Ints | None = None) -> Traffic:
    """The vehicles of a snapshot, or those of its indices `members`, in that order."""
    pick = slice(None) if members is None else members
    return Traffic(**{name: getattr(snapshot, name)[pick] for name in Traffic.__dataclass_fields__})


@dataclass(frozen=True, slots=True)
class Rows:
    """m rows c_target u[target] - c_source u[source] <= bound, coefficients positive, bound in m/s."""

    source: Ints
    target: Ints
    c_source: Floats
    c_target: Floats
    bound: Floats

    def __len__(self) -> int:
        return len(self.source)


def objective(vehicles: Traffic, trade_off: float) -> tuple[Floats, Floats, float]:
    """(diagonal of P (n,), q (n,), constant) of `eq:J2`; with Ps = Pv = 1 it is `eq:J`.

    J = sum_i lambda Ps_i (u_i - vbar_i)^2 + (1 - lambda) Pv_i (u_i - v_i)^2, `trade_off` being lambda.
    """
    go, steady = trade_off * vehicles.speed_priority, (1.0 - trade_off) * vehicles.variation_priority
    v, limit = vehicles.v, vehicles.v_max
    constant = float(np.sum(go * limit * limit + steady * v * v))
    return 2.0 * (go + steady), -2.0 * (go * limit + steady * v), constant


def boxes(vehicles: Traffic, dt_s: float) -> tuple[Floats, Floats]:
    """(lower (n,), upper (n,)) of `eq:eq_cons_1` and `eq:eq_cons_2`, m/s.

    A vehicle that cannot brake to its limit within the step brakes as hard as it can: upper = lower.
    """
    lower = np.maximum(0.0, vehicles.v - vehicles.b_max * dt_s)
    upper = np.minimum(vehicles.v_max, vehicles.v + vehicles.a_max * dt_s)
    return lower, np.maximum(upper, lower)


def rear_end_rows(vehicles: Traffic, gap_m: float, dt_s: float) -> Rows:
    """`eq: long_linear` for consecutive vehicles of a lane (source ahead of target), `gap_m` = M_sr.

    Two that part ways are held together only while the one ahead is still on the lane with its rear.
    """
    front = np.lexsort((vehicles.s, vehicles.lane))
    lead, follow = front[:-1], front[1:]
    on_lane = vehicles.s[lead] + vehicles.length[lead] > 0.0
    same_way = vehicles.movement[lead] == vehicles.movement[follow]
    kept = (vehicles.lane[lead] == vehicles.lane[follow]) & (on_lane | same_way)
    lead, follow = lead[kept], follow[kept]
    s, v = vehicles.s, vehicles.v
    least = v[follow] - v[lead] + 2.0 / dt_s * (s[lead] - s[follow] + vehicles.length[lead] + gap_m)
    unit = np.full(len(lead), np.sqrt(0.5))
    return Rows(lead, follow, unit, unit, -least * unit)


def lateral_rows(
    vehicles: Traffic, order: Ints, conflict: Bools, margin_m: float, dt_s: float, *, reduced: bool
) -> Rows:
    """`eq: lateral_linear`: u_j (z_i + l_i + M_sl) <= u_i z_j, z = s - dt/2 v, for i before j in conflict.

    `order` (n,) is the sequence, `conflict` (M, M) the movements' matrix, `margin_m` = M_sl. A vehicle inside
    (z <= 0) goes before all that are not and is never a target; a source that has cleared has no row.
    `reduced` drops the rows that others imply.
    """
    z = vehicles.s - 0.5 * dt_s * vehicles.v
    reach = z + vehicles.length + margin_m
    order = order[np.argsort(z[order] > 0.0, kind="stable")]
    movement = vehicles.movement[order]
    before = np.triu(conflict[np.ix_(movement, movement)], k=1)
    before &= (reach[order] > 0.0)[:, None] & (z[order] > 0.0)[None, :]
    if reduced:
        before = transitive_reduction(before)
    source, target = np.nonzero(before)
    source, target = order[source], order[target]
    norm = np.hypot(reach[source], z[target])
    return Rows(source, target, z[target] / norm, reach[source] / norm, np.zeros(len(source)))


def transitive_reduction(before: Bools) -> Bools:
    """The least part of a strictly upper triangular (n, n) relation with the same reachability.

    Lateral rows compose: i-j and j-k imply i-k, whether or not i and k conflict. With b = z + l + M_sl,
    multiply b_j u_k <= z_k u_j by b_i > 0, use b_i u_j <= z_j u_i and divide by z_j > 0: it says
    b_i (b_j / z_j) u_k <= z_k u_i, while b_j >= z_j and u_k >= 0. Hence the sources with b <= 0 and the
    targets with z <= 0 that `lateral_rows` leaves out. A follower in the lane of j is not implied.
    Sets of vehicles are the bits of one integer each: 260 vehicles fit in five machine words.
    """
    n = len(before)
    packed = np.packbits(before, axis=1, bitorder="little")
    later = [int.from_bytes(row.tobytes(), "little") for row in packed]
    reached = [0] * n
    rows: list[int] = []
    columns: list[int] = []
    for i in range(n - 1, -1, -1):
        left, seen = later[i], 0
        while left:
            j = (left & -left).bit_length() - 1
            rows.append(i)
            columns.append(j)
            seen |= reached[j] | (1 << j)
            left &= ~seen
        reached[i] = seen
    kept = np.zeros_like(before)
    kept[rows, columns] = True
    return kept


def join(first: Rows, second: Rows) -> Rows:
    """The rows of both, the first's first."""
    return Rows(*(np.concatenate([getattr(first, f), getattr(second, f)]) for f in Rows.__dataclass_fields__))


def assemble(
    vehicles: Traffic, trade_off: float, dt_s: float, rear_end: Rows, lateral: Rows, *, elastic: bool = True
) -> QP:
    """The program over x = (u (n,), a slack of each rear-end, then of each lateral row if elastic).

    A = [I; rows with -1 on their slack; I on the slacks]. Slacks are >= 0 and cost `REAR_END_PENALTY` or
    `LATERAL_PENALTY`, so that the program always has a solution. Hard rows are for tests.
    """
    n, rows = len(vehicles), join(rear_end, lateral)
    m, slacks = len(rows), len(rows) if elastic else 0
    quadratic, linear, constant = objective(vehicles, trade_off)
    lower, upper = boxes(vehicles, dt_s)
    if elastic:
        linear_slack, quadratic_slack = np.repeat(
            [REAR_END_PENALTY, LATERAL_PENALTY], [len(rear_end), len(lateral)], axis=0
        ).T
        quadratic = np.concatenate([quadratic, 2.0 * quadratic_slack])
        linear = np.concatenate([linear, linear_slack])
    row, slack = n + np.arange(m), np.arange(slacks)
    A = csc(
        (n + m + slacks, n + slacks),
        np.concatenate([np.arange(n), row, row, row[:slacks], n + m + slack]),
        np.concatenate([np.arange(n), rows.target, rows.source, n + slack, n + slack]),
        np.concatenate([np.ones(n), rows.c_target, -rows.c_source, -np.ones(slacks), np.ones(slacks)]),
    )
    l = np.concatenate([lower, np.full(m, -np.inf), np.zeros(slacks)])  # noqa: E741
    u = np.concatenate([upper, rows.bound, np.full(slacks, np.inf)])
    return QP(diagonal(quadratic), linear, A, l, u, constant)


def largest_feasible(lower: Floats, upper: Floats, rows: Rows, order: Ints) -> Floats | None:
    """(n,) the largest speeds that meet boxes and rows, None where nothing does: the exact feasibility test.

    Every row is u_j <= f(u_i) with f increasing, so with sources before targets in `order` (n,) one sweep
    gives the largest point, and any feasible point lies below it. Raises ValueError where a row runs
    backwards.
    """
    turn = np.empty(len(order), dtype=np.int64)
    turn[order] = np.arange(len(order))
    if np.any(turn[rows.source] >= turn[rows.target]):
        raise ValueError("a row's source comes after its target in the order")
    speeds: list[float] = upper.tolist()
    sweep = np.argsort(turn[rows.target], kind="stable")
    columns = (getattr(rows, name)[sweep].tolist() for name in Rows.__dataclass_fields__)
    for source, target, c_source, c_target, bound in zip(*columns, strict=True):
        speeds[target] = min(speeds[target], (bound + c_source * speeds[source]) / c_target)
    largest = np.array(speeds)
    return largest if np.all(largest >= lower) else None


def violations(rows: Rows, speeds: Floats) -> Floats:
    """(m,) by how much each row is violated at these speeds (n,), m/s: the slack it needs there."""
    left = rows.c_target * speeds[rows.target] - rows.c_source * speeds[rows.source]
    return np.maximum(left - rows.bound, 0.0)
