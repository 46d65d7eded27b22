"""A platoon's horizon program as a least-distance problem, the form that an active-set method works in.

With P = R'R and u = R^-1 z the program's 1/2 u'Pu + q'u becomes 1/2 z'z + f'z, f = R^-T q, and its rows A u become
(A R^-1) z. P is tridiagonal for each vehicle, so R is upper bidiagonal and R^-1 an upper triangle of H x H for each:
the whole change of variables costs about as much as one look at the rows. Arrays are in the order of `horizon.rows`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gameopt_im.core.corridor import FAR_MPS
from gameopt_im.core.horizon import row_of
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats

UPPER, LOWER = 1, 3
"""What a row that is taken to bind, at its upper or its lower bound, is marked with: the bits that DAQP reads."""


@kernel
def inverse_factors(curvature: Floats, h: int) -> Floats:
    """(n, H, H) R^-1 of each vehicle, from the data of P's upper triangle by columns: d_1, then (c_k, d_k)."""
    width = 2 * h - 1
    n = curvature.shape[0] // width
    out = np.zeros((n, h, h))
    diagonal, above = np.empty(h), np.zeros(h)
    for i in range(n):
        at, below = i * width, 0.0
        for k in range(h):
            diagonal[k] = np.sqrt(curvature[at + 2 * k] - below)
            if k + 1 < h:
                above[k] = curvature[at + 2 * k + 1] / diagonal[k]
                below = above[k] ** 2
        for j in range(h):
            out[i, j, j] = 1.0 / diagonal[j]
            for k in range(j - 1, -1, -1):
                out[i, k, j] = -above[k] * out[i, k + 1, j] / diagonal[k]
    return out


@kernel
def transformed(factors: Floats, q: Floats, way: Floats, rows: Floats) -> Floats:
    """f (n * H,); writes A R^-1 to `rows` ((4 n - 1) H, n H), of which only what is ever written needs to be 0 before.

    `way` (H, H) is `horizon.mean_speeds`, `factors` are those of `inverse_factors`.
    """
    n, h = factors.shape[0], factors.shape[1]
    f = np.empty(n * h)
    for i in range(n):
        own = factors[i]
        for j in range(h):
            column = i * h + j
            total = 0.0
            for k in range(j + 1):
                total += own[k, j] * q[i * h + k]
            f[column] = total
            for k in range(h):
                mean = 0.0
                for m in range(min(j, k) + 1):
                    mean += way[k, m] * own[m, j]
                rows[row_of(n, h, i, 0, k), column] = mean
                rows[row_of(n, h, i, 1, k), column] = own[k, j]
                rows[row_of(n, h, i, 2, k), column] = own[k, j] - own[k - 1, j] if k > 0 else own[k, j]
                if i > 0:
                    rows[row_of(n, h, i, 3, k), column] = mean
                if i + 1 < n:
                    rows[row_of(n, h, i + 1, 3, k), column] = -mean
    return f


@kernel
def working_set(y: Floats, lower: Floats, upper: Floats) -> npt.NDArray[np.int32]:
    """(m,) which rows to take to bind: those with a multiplier, where there is a bound."""
    out = np.zeros(y.shape[0], dtype=np.int32)
    for i in range(y.shape[0]):
        if y[i] > 0.0 and upper[i] < FAR_MPS:
            out[i] = UPPER
        elif y[i] < 0.0 and lower[i] > -FAR_MPS:
            out[i] = LOWER
    return out


@kernel
def speeds(factors: Floats, z: Floats) -> Floats:
    """u = R^-1 z, (n * H,)."""
    n, h = factors.shape[0], factors.shape[1]
    u = np.zeros(n * h)
    for i in range(n):
        for k in range(h):
            for j in range(k, h):
                u[i * h + k] += factors[i, k, j] * z[i * h + j]
    return u
