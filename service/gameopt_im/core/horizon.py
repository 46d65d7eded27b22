"""The horizon program: `eq:J2` over a few steps, inside the corridor that each vehicle's slot leaves it.

Variables u (n, H): the speeds at the ends of H blocks of lengths D_k, linear in between; u_0 = v is given.
    minimise  sum_i sum_k  lambda Ps_i (u_ik - vmax_i)^2 + (1 - lambda) Pv_i (u_ik - u_i,k-1)^2
The way covered is p_k = sum_{l <= k} D_l (u_{l-1} + u_l) / 2. Rows, all in m/s (ways divided by their time):
    corridor   p_lo <= p <= p_hi     between the latest and the fastest approach that still makes the slot
    boxes      0 <= u <= vmax,  -d D_k <= u_k - u_{k-1} <= a D_k
    rear end   p_follower - p_leader <= s_follower - s_leader - l_leader - M_sr    along each lane
With H = 1 and D_1 = Delta t this is the paper's program without its lateral rows, which the slots replace.
The bounds are widened to hold the reference, the approach law's own way, with SLACK_MPS to spare: a solution
exists, and not only on an edge, where a first-order solver would spend its iterations.
Lanes share no row, so each is a program of its own, and two candidates that leave a lane its slots share it. A lane of
more than LONGEST is cut into platoons; whoever is first in a later one stays behind the reference of the one ahead.
A depends on nothing but a platoon's number of vehicles, and P couples no two of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from gameopt_im.core.corridor import Approaching, bounds_of
from gameopt_im.core.kinematics import Manner, kernel
from gameopt_im.core.program import QP, Csc
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_wire.messages import STEP_S

LONGEST = 10
"""Vehicles in one program at the most: the solver takes many times as long for twice as many."""


@dataclass(frozen=True, slots=True)
class HorizonTask:
    """What the candidates of one control cycle share: n uncleared vehicles, lane by lane, front to back.

    `counts` are the platoons' numbers of vehicles: a lane is one, or several of `LONGEST` at the most, of which the
    later begin with a vehicle that `trails` (n,) the one before it in the arrays. `room` (n, H) is how far each may go
    behind a cleared leader by the end of each block, NEVER where it has none. The rest as in `Demand`; `ps`, `pv` the
    priorities.
    """

    counts: tuple[int, ...]
    s: Floats
    v: Floats
    length: Floats
    a: Floats
    b: Floats
    top: Floats
    line_cap: Floats
    ps: Floats
    pv: Floats
    room: Floats
    trails: Bools

    def approaching(self) -> Approaching:
        """What the bounds follow from, beside the slots."""
        return Approaching(
            self.s, self.v, self.length, self.a, self.b, self.top, self.line_cap, self.room, self.trails
        )  # fmt: skip


def platoons(lanes: Sequence[int]) -> tuple[tuple[int, ...], Bools]:
    """(counts, trails) as in `HorizonTask`, from the lanes' numbers of vehicles: parts as equal as may be."""
    counts: list[int] = []
    trails = np.zeros(sum(lanes), dtype=np.bool_)
    for count in lanes:
        parts = -(-count // LONGEST)
        for part in range(parts):
            if part:
                trails[sum(counts)] = True
            counts.append(count // parts + (part < count % parts))
    return tuple(counts), trails


@dataclass(frozen=True, slots=True)
class HorizonRules:
    """The constants of the program: block lengths (s), lambda, M_sr (m), the approach law."""

    blocks: tuple[float, ...]
    trade_off: float
    rear_gap: float
    manner: Manner


def carried_over(duals: Floats, row: Ints) -> Floats:
    """(n, 4, H) the multipliers of vehicles that were in these rows (n,); 0 where one was in none, that is -1."""
    return np.where((row >= 0)[:, None, None], duals[row], 0.0)


@lru_cache(maxsize=512)
def way_matrix(blocks: tuple[float, ...]) -> Floats:
    """(H, H): p = way_matrix @ u + D_1 v / 2 for one vehicle."""
    d = np.array(blocks)
    step = np.diag(0.5 * d) + np.diag(0.5 * d[1:], -1)
    return np.asarray(np.cumsum(step, axis=0))


@lru_cache(maxsize=512)
def lengths(blocks: tuple[float, ...]) -> Floats:
    """(H,) as an array; not to be written to."""
    return np.array(blocks)


@lru_cache(maxsize=512)
def mean_speeds(blocks: tuple[float, ...]) -> Floats:
    """(H, H): `way_matrix` over the time it takes: the mean speeds by the ends of the blocks. Not to be written to."""
    return np.asarray(way_matrix(blocks) / np.cumsum(blocks)[:, None])


@lru_cache(maxsize=512)
def rows(n: int, blocks: tuple[float, ...]) -> Csc:
    """A of a platoon of n: corridor, speed and acceleration rows of every vehicle, then the rear-end rows."""
    h = len(blocks)
    way = sp.csr_matrix(mean_speeds(blocks))
    change = sp.csr_matrix(np.eye(h) - np.eye(h, k=-1))
    parts = [sp.kron(sp.eye(n), way), sp.eye(n * h), sp.kron(sp.eye(n), change)]
    if n > 1:
        parts.append(sp.kron(sp.eye(n - 1, n, k=1) - sp.eye(n - 1, n), way))
    return _compact(sp.csc_matrix(sp.vstack(parts)))


def _compact(matrix: Any) -> Csc:
    """The matrix without the zeros that a Kronecker product stores."""
    matrix.eliminate_zeros()
    matrix.sort_indices()
    rows_, columns = matrix.shape
    return Csc((rows_, columns), matrix.data, matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64))


@lru_cache(maxsize=512)
def _cost_pattern(n: int, h: int) -> Csc:
    """The pattern of P's upper triangle: one bidiagonal block per vehicle; data hold its own index."""
    block = sp.csc_matrix(np.eye(h) + np.eye(h, k=1))
    pattern = sp.csc_matrix(sp.kron(sp.eye(n), block))
    return _compact(pattern)


@kernel
def cost(ps: Floats, pv: Floats, top: Floats, v: Floats, trade_off: float, h: int) -> tuple[Floats, Floats]:
    """(data of P's upper triangle (n, 2 H - 1), q (n, H)) of 1/2 u'Pu + q'u: `eq:J2` over the horizon.

    Its constant is left out. By columns: d_1, then (-steady, d_k) for k > 1.
    """
    n = ps.shape[0]
    data, q = np.empty((n, 2 * h - 1)), np.empty((n, h))
    for i in range(n):
        fast, steady = 2.0 * trade_off * ps[i], 2.0 * (1.0 - trade_off) * pv[i]
        for k in range(h):
            data[i, 2 * k] = fast + 2.0 * steady if k + 1 < h else fast + steady
            if k > 0:
                data[i, 2 * k - 1] = -steady
            q[i, k] = -fast * top[i]
        q[i, 0] -= steady * v[i]
    return data, q


BOUND, REFERENCE, MULTIPLIER = 4, 8, 9
"""How many times H columns beyond a row's lower bound `build` has its upper one and its multiplier; beyond that of the
first kind of row, the approach law's speed.
"""


@kernel
def column_of(h: int, kind: int, k: int) -> int:
    """The column of `build` of the lower bound of a row: of four kinds, corridor, speed, change and rear end."""
    return (3 + kind) * h - 1 + k


def build(task: HorizonTask, rules: HorizonRules, slot: Floats, guess: Floats | None = None) -> Floats:
    """(n, 16 H - 1) the programs of one candidate, one after the other, since its platoons share no row.

    Side by side: P's data, q, l and u of the four kinds of row, the approach law's speeds, and the multipliers
    (n, 4, H) that are guessed, 0 where none are given. One array goes to a worker several times as fast as six.
    """
    given = bounds_of(task.approaching(), slot, lengths(rules.blocks), rules.manner, rules.rear_gap)
    h = len(rules.blocks)
    data, q = cost(task.ps, task.pv, task.top, task.v, rules.trade_off, h)
    duals = np.zeros_like(given.lower) if guess is None else guess
    return _side_by_side(data, q, given.lower, given.upper, given.reference, duals)


@kernel
def _side_by_side(data: Floats, q: Floats, lower: Floats, upper: Floats, reference: Floats, duals: Floats) -> Floats:
    n, h = q.shape
    values = np.empty((n, 16 * h - 1))
    for i in range(n):
        at = 2 * h - 1
        values[i, :at] = data[i]
        for k in range(h):
            values[i, at + k] = q[i, k]
            values[i, column_of(h, 0, k) + REFERENCE * h] = reference[i, k]
            for kind in range(4):
                column = column_of(h, kind, k)
                values[i, column], values[i, column + BOUND * h] = lower[i, kind, k], upper[i, kind, k]
                values[i, column + MULTIPLIER * h] = duals[i, kind, k]
    return values


def program(values: Floats, blocks: tuple[float, ...], scale: float = 1.0) -> tuple[QP, Floats]:
    """The program of a platoon with these rows of `build`, its cost times `scale`, and its reference (n * H,).

    All of one size have the same A.
    """
    count, h = len(values), len(blocks)
    pattern = _cost_pattern(count, h)
    data, q, lower, upper, reference = _in_rows(values, h, scale)
    cost_matrix = Csc(pattern.shape, data, pattern.indices, pattern.indptr)
    return QP(cost_matrix, q, rows(count, blocks), lower, upper), reference


@kernel
def _in_rows(values: Floats, h: int, scale: float) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """What `build` put side by side, in the order of `rows`: kind by kind, of the last all but the first vehicle's."""
    n = values.shape[0]
    data, q, reference = np.empty(n * (2 * h - 1)), np.empty(n * h), np.empty(n * h)
    lower, upper = np.empty((4 * n - 1) * h), np.empty((4 * n - 1) * h)
    at = 2 * h - 1
    for i in range(n):
        for k in range(at):
            data[i * at + k] = scale * values[i, k]
        for k in range(h):
            q[i * h + k] = scale * values[i, at + k]
            reference[i * h + k] = values[i, column_of(h, 0, k) + REFERENCE * h]
            for kind in range(4 if i > 0 else 3):
                row, column = row_of(n, h, i, kind, k), column_of(h, kind, k)
                lower[row], upper[row] = values[i, column], values[i, column + BOUND * h]
    return data, q, lower, upper, reference


@kernel
def row_of(n: int, h: int, i: int, kind: int, k: int) -> int:
    """The row of `rows` of vehicle i, a kind, and a block; the first has none of the last kind."""
    return ((kind * n + i) if kind < 3 else 3 * n + i - 1) * h + k


@kernel
def by_vehicle(values: Floats, n: int, scale: float) -> Floats:
    """(n, 4, H): what is in the order of `rows` over `scale`, 0 for the rows that the first does not have."""
    h = values.shape[0] // (4 * n - 1)
    out = np.zeros((n, 4, h))
    for i in range(n):
        for kind in range(4 if i > 0 else 3):
            for k in range(h):
                out[i, kind, k] = values[row_of(n, h, i, kind, k)] / scale
    return out


@kernel
def violation(values: Floats, u: Floats, way: Floats) -> float:
    """The most that u (n, H) violates a row of the program `values`, m/s; not a number where something is none.

    `way` (H, H) is `mean_speeds`.
    """
    n, h = u.shape
    worst, ahead = 0.0, np.zeros(h)
    for i in range(n):
        mean = np.zeros(h)
        for k in range(h):
            for m in range(k + 1):
                mean[k] += way[k, m] * u[i, m]
            for kind in range(4 if i > 0 else 3):
                if kind == 0:
                    row = mean[k]
                elif kind == 1:
                    row = u[i, k]
                elif kind == 2:
                    row = u[i, k] - (u[i, k - 1] if k > 0 else 0.0)
                else:
                    row = mean[k] - ahead[k]
                column = column_of(h, kind, k)
                lower, upper = values[i, column], values[i, column + BOUND * h]
                if np.isnan(row) or np.isnan(lower) or np.isnan(upper):
                    return np.nan
                worst = max(worst, lower - row, row - upper)
        ahead = mean
    return worst


def first_speeds(task: HorizonTask, rules: HorizonRules, u: Floats) -> Floats:
    """(n,) the speed at the end of the coming control cycle, on the way to the first block's end."""
    share = min(1.0, STEP_S / rules.blocks[0])
    return np.asarray(task.v + share * (u.reshape(len(task.s), -1)[:, 0] - task.v))


def objective(task: HorizonTask, rules: HorizonRules, u: Floats) -> float:
    """J of a solution (n * H,): `eq:J2` summed over the horizon, (m/s)^2."""
    return _objective(u.reshape(len(task.s), -1), task.v, task.top, task.ps, task.pv, rules.trade_off)


@kernel
def _objective(u: Floats, v: Floats, top: Floats, ps: Floats, pv: Floats, trade_off: float) -> float:
    total = 0.0
    for i in range(u.shape[0]):
        before, fast, steady = v[i], 0.0, 0.0
        for speed in u[i]:
            fast += (speed - top[i]) ** 2
            steady += (speed - before) ** 2
            before = speed
        total += trade_off * ps[i] * fast + (1.0 - trade_off) * pv[i] * steady
    return total
