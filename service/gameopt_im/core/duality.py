"""What the horizon program of a candidate can come to at best, by the multipliers of another: weak duality."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.corridor import Bounds
from gameopt_im.core.horizon import HorizonRules, HorizonTask, cost, mean_speeds
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats, Ints

FAR_MPS = 1e4
"""A bound this far off is none, m/s."""


def least_objective(task: HorizonTask, rules: HorizonRules, given: Bounds, duals: Floats, play: float) -> float:
    """A bound from below on J over all u that keep to `given` but for `play` (m/s) a row.

    By weak duality any multipliers (n, 4, H) give one, and those of a candidate with slots much alike a close one.
    """
    dual = _dual_value(
        np.array(task.counts), task.ps, task.pv, task.top, task.v, rules.trade_off, mean_speeds(rules.blocks),
        given.lower, given.upper, play, duals,
    )  # fmt: skip
    return max(0.0, float(dual))


@kernel
def _dual_value(
    counts: Ints,
    ps: Floats,
    pv: Floats,
    top: Floats,
    v: Floats,
    trade_off: float,
    way: Floats,
    lower: Floats,
    upper: Floats,
    play: float,
    duals: Floats,
) -> float:
    """The constant of J and the dual function -1/2 r'P^-1 r - sum (u y+ - l y-) with r = q + A'y, at the y that fit.

    `way` (H, H) as in A. -inf where P is singular.
    """
    data, q = cost(ps, pv, top, v, trade_off, way.shape[0])
    n, h = q.shape
    y, value, first = duals.copy(), 0.0, 0
    for i in range(n):
        value += h * trade_off * ps[i] * top[i] ** 2 + (1.0 - trade_off) * pv[i] * v[i] ** 2
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
