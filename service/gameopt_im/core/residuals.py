"""How good a solution is, computed apart from the solver that found it. Compiled; matrices by columns, as in `Csc`."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.program import QP
from gameopt_im.core.snapshot import Floats, Ints


@kernel
def violation(x: Floats, data: Floats, indices: Ints, indptr: Ints, lower: Floats, upper: Floats) -> float:
    """Largest violation of lower <= A x <= upper (m,); not a number where a row's value or a bound is none."""
    ax = np.zeros(lower.shape[0])
    for j in range(x.shape[0]):
        for k in range(indptr[j], indptr[j + 1]):
            ax[indices[k]] += data[k] * x[j]
    worst = 0.0
    for i in range(ax.shape[0]):
        if np.isnan(ax[i]) or np.isnan(lower[i]) or np.isnan(upper[i]):
            return np.nan
        worst = max(worst, lower[i] - ax[i], ax[i] - upper[i])
    return worst


@kernel
def quadratic(x: Floats, data: Floats, indices: Ints, indptr: Ints, q: Floats) -> float:
    """1/2 x'Px + q'x for the upper triangle of P."""
    value = 0.0
    for j in range(x.shape[0]):
        value += q[j] * x[j]
        for k in range(indptr[j], indptr[j + 1]):
            value += (0.5 if indices[k] == j else 1.0) * data[k] * x[indices[k]] * x[j]
    return value


def residual(qp: QP, x: Floats) -> float:
    """Largest violation of l <= Ax <= u, m/s; not a number where x or a bound is none."""
    return violation(x, qp.A.data, qp.A.indices, qp.A.indptr, qp.l, qp.u)


def objective(qp: QP, x: Floats) -> float:
    """1/2 x'Px + q'x + constant."""
    return quadratic(x, qp.P.data, qp.P.indices, qp.P.indptr, qp.q) + qp.constant
