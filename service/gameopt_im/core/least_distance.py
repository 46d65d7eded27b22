"""A platoon's horizon program as a least-distance problem, the form that an active-set method works in. Compiled.

With P = R'R and u = R^-1 z the program's 1/2 u'Pu + q'u becomes 1/2 z'z + f'z, f = R^-T q, and its rows A u become
(A R^-1) z. P is tridiagonal for each vehicle, so R is upper bidiagonal and R^-1 an upper triangle of H x H for each. A
row touches its own vehicle's H variables, and a rear-end row those of the vehicle ahead. `values` are of
`horizon.build`; z, f and speeds are (n, H). A row is named by its vehicle, its kind (`horizon`'s four) and its block.
"""

from __future__ import annotations

import numpy as np

from gameopt_im.core.horizon import BOUND, column_of
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats

CORRIDOR, SPEED, CHANGE, REAR_END = 0, 1, 2, 3


@kernel
def inverse_factors(values: Floats, h: int) -> Floats:
    """(n, H, H) R^-1 of each vehicle, from the data of P's upper triangle by columns: d_1, then (c_k, d_k)."""
    n = values.shape[0]
    out = np.zeros((n, h, h))
    diagonal, above = np.empty(h), np.zeros(h)
    for i in range(n):
        below = 0.0
        for k in range(h):
            diagonal[k] = np.sqrt(values[i, 2 * k] - below)
            if k + 1 < h:
                above[k] = values[i, 2 * k + 1] / diagonal[k]
                below = above[k] ** 2
        for j in range(h):
            out[i, j, j] = 1.0 / diagonal[j]
            for k in range(j - 1, -1, -1):
                out[i, k, j] = -above[k] * out[i, k + 1, j] / diagonal[k]
    return out


@kernel
def linear(factors: Floats, values: Floats) -> Floats:
    """f = R^-T q."""
    n, h = factors.shape[0], factors.shape[1]
    f = np.zeros((n, h))
    for i in range(n):
        for j in range(h):
            for k in range(j + 1):
                f[i, j] += factors[i, k, j] * values[i, 2 * h - 1 + k]
    return f


@kernel
def own_rows(factors: Floats, way: Floats) -> Floats:
    """(n, 3, H, H) A R^-1 but for the rear-end rows: those are the corridor's, less those of the vehicle ahead.

    `way` (H, H) is `horizon.mean_speeds`.
    """
    n, h = factors.shape[0], factors.shape[1]
    rows = np.empty((n, 3, h, h))
    for i in range(n):
        for k in range(h):
            for j in range(h):
                mean = 0.0
                for m in range(min(j, k) + 1):
                    mean += way[k, m] * factors[i, m, j]
                rows[i, CORRIDOR, k, j] = mean
                rows[i, SPEED, k, j] = factors[i, k, j]
                rows[i, CHANGE, k, j] = factors[i, k, j] - (factors[i, k - 1, j] if k > 0 else 0.0)
    return rows


@kernel
def product(rows: Floats, i: int, kind: int, k: int, j: int, other: int, m: int) -> float:
    """A row times another: vehicle, kind and block of either."""
    own, others = kind % REAR_END, other % REAR_END
    if i == j:
        total = _times(rows, i, own, k, others, m)
        if kind == REAR_END and other == REAR_END:
            total += _times(rows, i - 1, CORRIDOR, k, CORRIDOR, m)
        return total
    if kind == REAR_END and i - 1 == j:
        return -_times(rows, j, CORRIDOR, k, others, m)
    if other == REAR_END and j - 1 == i:
        return -_times(rows, i, own, k, CORRIDOR, m)
    return 0.0


@kernel
def _times(rows: Floats, i: int, kind: int, k: int, other: int, m: int) -> float:
    total = 0.0
    for at in range(rows.shape[3]):
        total += rows[i, kind, k, at] * rows[i, other, m, at]
    return total


@kernel
def value(rows: Floats, z: Floats, i: int, kind: int, k: int) -> float:
    """A row times z."""
    own, total = kind % REAR_END, 0.0
    for m in range(z.shape[1]):
        total += rows[i, own, k, m] * z[i, m]
    if kind == REAR_END:
        for m in range(z.shape[1]):
            total -= rows[i - 1, CORRIDOR, k, m] * z[i - 1, m]
    return total


@kernel
def subtract(rows: Floats, z: Floats, times: float, i: int, kind: int, k: int) -> None:
    """Takes so many times a row from z."""
    own = kind % REAR_END
    for m in range(z.shape[1]):
        z[i, m] -= times * rows[i, own, k, m]
    if kind == REAR_END:
        for m in range(z.shape[1]):
            z[i - 1, m] += times * rows[i - 1, CORRIDOR, k, m]


@kernel
def most_violated(rows: Floats, values: Floats, z: Floats) -> tuple[int, int, int, float, float]:
    """The row that z violates most: vehicle, kind, block, 1 above its upper bound or -1 below its lower, and by how
    much, m/s; 0 with none.
    """
    n, h = z.shape
    vehicle, which, block, sign, most = 0, 0, 0, 1.0, 0.0
    ahead, mean = np.empty(h), np.empty(h)
    for i in range(n):
        before = 0.0
        for k in range(h):
            mean[k] = value(rows, z, i, CORRIDOR, k)
            speed = value(rows, z, i, SPEED, k)
            for kind in range(4 if i > 0 else 3):
                if kind == CORRIDOR:
                    found = mean[k]
                elif kind == SPEED:
                    found = speed
                elif kind == CHANGE:
                    found = speed - before
                else:
                    found = mean[k] - ahead[k]
                column = column_of(h, kind, k)
                over, under = found - values[i, column + BOUND * h], values[i, column] - found
                if max(over, under) > most:
                    vehicle, which, block, most = i, kind, k, max(over, under)
                    sign = 1.0 if over > under else -1.0
            before = speed
        ahead, mean = mean, ahead
    return vehicle, which, block, sign, most


@kernel
def speeds(factors: Floats, z: Floats) -> Floats:
    """u = R^-1 z."""
    n, h = z.shape
    u = np.zeros((n, h))
    for i in range(n):
        for k in range(h):
            for m in range(k, h):
                u[i, k] += factors[i, k, m] * z[i, m]
    return u
