"""What the horizon program of a candidate can come to at best, by the multipliers of another: weak duality."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.corridor import FAR_MPS, Approaching, bounds_of
from gameopt_im.core.horizon import HorizonRules, HorizonTask, cost, lengths, mean_speeds
from gameopt_im.core.kinematics import Manner, kernel
from gameopt_im.core.snapshot import Floats, Ints


def least_objectives(task: HorizonTask, rules: HorizonRules, slots: Floats, duals: Floats, play: float) -> Floats:
    """(C,) bounds from below on J of candidates with these `slots` (C, n), if they keep to their rows but for `play`.

    By weak duality any multipliers (n, 4, H) give one, and those of a candidate with slots much alike a close one.
    `play` in m/s.
    """
    h = len(rules.blocks)
    data, q = cost(task.ps, task.pv, task.top, task.v, rules.trade_off, h)
    constant = np.sum(h * rules.trade_off * task.ps * task.top**2 + (1.0 - rules.trade_off) * task.pv * task.v**2)
    duals_fit = _dual_values(
        task.approaching(), slots, lengths(rules.blocks), rules.manner, rules.rear_gap, np.array(task.counts), data, q,
        mean_speeds(rules.blocks), play, duals,
    )  # fmt: skip
    return np.maximum(0.0, constant + duals_fit)


@kernel
def _dual_values(
    who: Approaching,
    slots: Floats,
    blocks: Floats,
    manner: Manner,
    rear_gap: float,
    counts: Ints,
    data: Floats,
    q: Floats,
    way: Floats,
    play: float,
    duals: Floats,
) -> Floats:
    """(C,) the dual function of every candidate, each with its own bounds."""
    values = np.empty(slots.shape[0])
    for c in range(slots.shape[0]):
        given = bounds_of(who, slots[c], blocks, manner, rear_gap)
        values[c] = _dual_value(counts, data, q, way, given.lower, given.upper, play, duals)
    return values


@kernel
def _dual_value(
    counts: Ints, data: Floats, q: Floats, way: Floats, lower: Floats, upper: Floats, play: float, duals: Floats
) -> float:
    """The dual function -1/2 r'P^-1 r - sum (u y+ - l y-) with r = q + A'y, at the y of these duals that fit.

    `data` and `q` as `cost` gives them, `way` (H, H) as in A. -inf where P is singular.
    """
    n, h = q.shape
    y, value, first = duals.copy(), 0.0, 0
    for platoon in range(counts.shape[0]):
        y[first, 3] = 0.0
        first += counts[platoon]
    for i in range(n):
        for kind in range(4):
            for k in range(h):
                bound = upper[i, kind, k] + play if y[i, kind, k] > 0.0 else lower[i, kind, k] - play
                if abs(bound) > FAR_MPS:
                    y[i, kind, k] = 0.0
                else:
                    value -= bound * y[i, kind, k]
    r = np.empty(h)
    for i in range(n):
        for k in range(h):
            r[k] = q[i, k] + y[i, 1, k] + y[i, 2, k] - (y[i, 2, k + 1] if k + 1 < h else 0.0)
            for j in range(k, h):
                ahead = y[i + 1, 3, j] if i + 1 < n else 0.0  # 0 for the first of the next platoon
                r[k] += way[j, k] * (y[i, 0, j] + y[i, 3, j] - ahead)
        pivot = data[i, 0]
        for k in range(h):  # r'P^-1 r of a symmetric tridiagonal P, by elimination
            if k > 0:
                factor = data[i, 2 * k - 1] / pivot
                pivot = data[i, 2 * k] - factor * data[i, 2 * k - 1]
                r[k] -= factor * r[k - 1]
            if pivot <= 1e-12:
                return -np.inf
            value -= 0.5 * r[k] * r[k] / pivot
    return value
