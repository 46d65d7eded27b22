"""What a solver found, taken only after a look at it of our own."""

from __future__ import annotations

from dataclasses import dataclass

from gameopt_im.core.program import QP
from gameopt_im.core.residuals import quadratic, violation
from gameopt_im.core.snapshot import Floats


@dataclass(frozen=True, slots=True)
class Solution:
    """x (nx,), the objective there with its constant, the largest violation of l <= Ax <= u (m/s), multipliers y (m,).

    A multiplier is positive where a row is at its u.
    """

    x: Floats
    y: Floats
    objective: float
    residual: float
    iterations: int


def checked(qp: QP, x: Floats, y: Floats, iterations: int, residual_mps: float) -> Solution | None:
    """What was found, or None where a row is violated by more than `residual_mps`, or something is not a number."""
    residual = violation(x, qp.A.data, qp.A.indices, qp.A.indptr, qp.l, qp.u)
    if not residual <= residual_mps:
        return None
    objective = quadratic(x, qp.P.data, qp.P.indices, qp.P.indptr, qp.q) + qp.constant
    return Solution(x, y, objective, residual, iterations)
