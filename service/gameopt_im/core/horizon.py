"""The horizon program: `eq:J2` over a few steps, inside the corridor that each vehicle's slot leaves it.

Variables u (n, H): the speeds at the ends of H blocks of lengths D_k, linear in between; u_0 = v is given.
    minimise  sum_i sum_k  lambda Ps_i (u_ik - vmax_i)^2 + (1 - lambda) Pv_i (u_ik - u_i,k-1)^2
The way covered is p_k = sum_{l <= k} D_l (u_{l-1} + u_l) / 2. Rows, all in m/s (ways divided by their time):
    corridor   p_lo <= p <= p_hi     between the latest and the fastest approach that still makes the slot
    boxes      0 <= u <= vmax,  -d D_k <= u_k - u_{k-1} <= a D_k
    rear end   p_follower - p_leader <= s_follower - s_leader - l_leader - M_sr    along each lane
With H = 1 and D_1 = Delta t this is the paper's program without its lateral rows, which the slots replace.
The bounds are widened to hold the reference, the approach law's own way, with SLACK_MPS to spare: a solution
exists, and not only on an edge, where the solver would spend its iterations.
Lanes share no row, so each is a program of its own, and two candidates that leave a lane its slots share it.
A depends on nothing but the lane's number of vehicles: workspaces live on and only values change.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from gameopt_im.core.kinematics import NEVER, Manner, approach, approach_speed, kernel
from gameopt_im.core.program import QP, Csc
from gameopt_im.core.snapshot import Floats, Ints
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

SLACK_MPS = 0.1
"""Play left around the reference, m/s (of the mean speed for the corridor, of a change of speed for the boxes)."""


@dataclass(frozen=True, slots=True)
class HorizonTask:
    """What the candidates of one control cycle share: n uncleared vehicles, lane by lane, front to back.

    `counts` are the lanes' numbers of vehicles. `room` (n, H) is how far each may go behind a cleared leader by
    the end of each block, NEVER where it has none. The rest as in `Demand`; `ps`, `pv` the priorities.
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


@dataclass(frozen=True, slots=True)
class HorizonRules:
    """The constants of the program: block lengths (s), lambda, M_sr (m), the approach law."""

    blocks: tuple[float, ...]
    trade_off: float
    rear_gap: float
    manner: Manner


class Start(NamedTuple):
    """Where the solver starts: speeds u (n, H), NaN where the approach law's are to be taken; multipliers (n, 4, H)."""

    u: Floats
    duals: Floats

    def carried_over(self, row: Ints) -> Start:
        """The start of other vehicles that were in these rows (n,); -1 where one was in none."""
        known = row >= 0
        return Start(
            np.where(known[:, None], self.u[row], np.nan), np.where(known[:, None, None], self.duals[row], 0.0)
        )


@lru_cache(maxsize=512)
def way_matrix(blocks: tuple[float, ...]) -> Floats:
    """(H, H): p = way_matrix @ u + D_1 v / 2 for one vehicle."""
    d = np.array(blocks)
    step = np.diag(0.5 * d) + np.diag(0.5 * d[1:], -1)
    return np.asarray(np.cumsum(step, axis=0))


@lru_cache(maxsize=512)
def rows(n: int, blocks: tuple[float, ...]) -> Csc:
    """A of a lane of n: corridor, speed and acceleration rows of every vehicle, then the rear-end rows."""
    h = len(blocks)
    way = sp.csr_matrix(way_matrix(blocks) / np.cumsum(blocks)[:, None])
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


def cost(task: HorizonTask, rules: HorizonRules) -> tuple[Floats, Floats]:
    """(data of P's upper triangle (n, 2 H - 1), q (n, H)) of 1/2 u'Pu + q'u: `eq:J2` over the horizon.

    Its constant is left out.
    """
    n, h = len(task.s), len(rules.blocks)
    fast = 2.0 * rules.trade_off * task.ps
    steady = 2.0 * (1.0 - rules.trade_off) * task.pv
    diagonal = np.repeat((fast + 2.0 * steady)[:, None], h, axis=1)
    diagonal[:, -1] -= steady
    data = np.empty((n, 2 * h - 1))  # column order: d_1, then (-steady, d_k) for k > 1
    data[:, 0] = diagonal[:, 0]
    data[:, 1::2] = -steady[:, None]
    data[:, 2::2] = diagonal[:, 1:]
    q = np.repeat((-fast * task.top)[:, None], h, axis=1)
    q[:, 0] -= steady * task.v
    return data, q


@kernel
def reference(
    s: Floats,
    v: Floats,
    slot: Floats,
    a: Floats,
    b: Floats,
    top: Floats,
    cap: Floats,
    manner: Manner,
    blocks: Floats,
) -> tuple[Floats, Floats, Floats]:
    """(speeds at block ends (n, H), line speed (n,), first rate (n,)) of each vehicle driving the approach law."""
    n, h = s.shape[0], blocks.shape[0]
    out, line, first = np.empty((n, h)), np.empty(n), np.empty(n)
    for i in range(n):
        plan = approach(s[i], v[i], slot[i], a[i], b[i], top[i], cap[i], manner)
        line[i], first[i] = plan[2], plan[1]
        turn_b = min(motion.TURN_DECEL_MPS2, b[i])
        room, speed, k = s[i], v[i], 0
        for j in range(h):
            for _ in range(round(blocks[j] / STEP_S)):
                if room > 0.0:
                    u = approach_speed(
                        room,
                        speed,
                        slot[i] - k * STEP_S,
                        plan[0],
                        plan[1],
                        a[i],
                        top[i],
                        cap[i],
                        turn_b,
                        STEP_S,
                    )
                    u = min(u, motion.turn_speed(room, speed, b[i], STEP_S, cap[i]))
                else:
                    u = min(cap[i], speed + a[i] * STEP_S)
                u = max(0.0, u, speed - b[i] * STEP_S)
                room -= 0.5 * STEP_S * (speed + u)
                speed = u
                k += 1
            out[i, j] = speed
    return out, line, first


def corridor(task: HorizonTask, slot: Floats, line: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """(least, most) way by the end of each block, both (n, H), m, for crossing at `slot` with speed `line`.

    Most: at time tau before its slot the vehicle is at least where it has to start, accelerating at a, to reach
    the line speed at the line. Least: no farther from the line than full speed, braked for a turn, covers.
    """
    tau = slot[:, None] - ends[None, :]
    to_go = np.maximum(tau, 0.0)
    line_, a = line[:, None], task.a[:, None]
    run = np.minimum(to_go, line_ / a)
    nearest = line_ * run - 0.5 * a * run**2
    turn_b = np.minimum(motion.TURN_DECEL_MPS2, task.b)[:, None]
    faster = np.minimum(to_go, np.maximum(task.top[:, None] - line_, 0.0) / turn_b)
    farthest = line_ * to_go + turn_b * faster * (to_go - 0.5 * faster)
    past = np.maximum(-tau, 0.0) * line_
    most = np.where(tau > 0.0, task.s[:, None] - nearest, NEVER)
    return task.s[:, None] - farthest + past, most


@dataclass(frozen=True, slots=True)
class Bounds:
    """l and u of every row of one candidate, (n, 4, H): corridor, speed, change, and the rear end behind the vehicle
    ahead in the arrays, which the first of a lane does not follow: its row is in no program.

    `reference` (n, H) is the approach law's way, which they hold.
    """

    lower: Floats
    upper: Floats
    reference: Floats


def bounds(task: HorizonTask, rules: HorizonRules, slot: Floats) -> Bounds:
    """The bounds of one candidate."""
    blocks = np.array(rules.blocks)
    ends = np.cumsum(blocks)
    u_ref, line, rate = reference(task.s, task.v, slot, task.a, task.b, task.top, task.line_cap, rules.manner, blocks)
    start = 0.5 * blocks[0] * task.v[:, None]
    p_ref = u_ref @ way_matrix(rules.blocks).T + start
    least, most = corridor(task, slot, line, ends)
    most = np.minimum(most, task.room)
    lower = np.full((len(task.s), 4, len(blocks)), -np.inf)
    upper = np.full_like(lower, np.inf)
    lower[:, 0] = (np.minimum(least, p_ref) - start) / ends - SLACK_MPS
    upper[:, 0] = (np.maximum(most, p_ref) - start) / ends + SLACK_MPS
    lower[:, 1] = 0.0
    upper[:, 1] = np.maximum(task.top[:, None], u_ref)

    change = np.diff(u_ref, axis=1, prepend=task.v[:, None])
    decels = rules.manner.decels
    brake = np.maximum(np.maximum(-rate, decels[min(1, len(decels) - 1)]), 0.0)[:, None]
    lower[:, 2] = np.minimum(-brake * blocks, change) - SLACK_MPS
    upper[:, 2] = np.maximum(task.a[:, None] * blocks, change) + SLACK_MPS
    lower[:, 2, 0] += task.v
    upper[:, 2, 0] += task.v

    gap = task.s[1:] - task.s[:-1] - task.length[:-1] - rules.rear_gap
    behind = np.maximum(gap[:, None], p_ref[1:] - p_ref[:-1])
    upper[1:, 3] = (behind - (start[1:] - start[:-1])) / ends + SLACK_MPS
    return Bounds(lower, upper, u_ref)


def build(task: HorizonTask, rules: HorizonRules, slot: Floats) -> list[tuple[QP, Floats]]:
    """(program, the reference as a warm start (m * H,)) of each lane of one candidate: lanes share no row."""
    h = len(rules.blocks)
    given = bounds(task, rules, slot)
    data, q = cost(task, rules)
    made = []
    first = 0
    for count in task.counts:
        lane = slice(first, first + count)
        pattern = _cost_pattern(count, h)
        qp = QP(
            Csc(pattern.shape, data[lane].ravel(), pattern.indices, pattern.indptr),
            q[lane].ravel(),
            rows(count, rules.blocks),
            in_rows(given.lower[lane]),
            in_rows(given.upper[lane]),
        )
        made.append((qp, given.reference[lane].ravel()))
        first += count
    return made


def in_rows(values: Floats) -> Floats:
    """(m,) a lane's (n, 4, H) values in the order of `rows`."""
    return np.concatenate([*(values[:, kind].ravel() for kind in range(3)), values[1:, 3].ravel()])


def by_vehicle(values: Floats, n: int) -> Floats:
    """The inverse of `in_rows`: (n, 4, H), with 0 for the row that the first does not have."""
    h = len(values) // (4 * n - 1)
    out = np.zeros((n, 4, h))
    out[:, :3] = values[: 3 * n * h].reshape(3, n, h).swapaxes(0, 1)
    out[1:, 3] = values[3 * n * h :].reshape(n - 1, h)
    return out


def first_speeds(task: HorizonTask, rules: HorizonRules, u: Floats) -> Floats:
    """(n,) the speed at the end of the coming control cycle, on the way to the first block's end."""
    share = min(1.0, STEP_S / rules.blocks[0])
    return np.asarray(task.v + share * (u.reshape(len(task.s), -1)[:, 0] - task.v))


def objective(task: HorizonTask, rules: HorizonRules, u: Floats) -> float:
    """J of a solution (n * H,): `eq:J2` summed over the horizon, (m/s)^2."""
    speeds = u.reshape(len(task.s), -1)
    change = np.diff(speeds, axis=1, prepend=task.v[:, None])
    fast = rules.trade_off * task.ps * np.sum((speeds - task.top[:, None]) ** 2, axis=1)
    steady = (1.0 - rules.trade_off) * task.pv * np.sum(change**2, axis=1)
    return float(np.sum(fast + steady))
