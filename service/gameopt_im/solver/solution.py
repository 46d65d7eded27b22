"""What a solver found, taken only after a look at it of our own."""

from __future__ import annotations

from typing import NamedTuple

from gameopt_im.core.program import QP
from gameopt_im.core.residuals import residual
from gameopt_im.core.snapshot import Floats


class Solution(NamedTuple):
    """x (nx,), multipliers y (m,), and the largest violation of l <= Ax <= u (m/s).

    A multiplier is positive where a row is at its u.
    """

    x: Floats
    y: Floats
    residual: float
    iterations: int


def checked(qp: QP, x: Floats, y: Floats, iterations: int, residual_mps: float) -> Solution | None:
    """What was found, or None where a row is violated by more than `residual_mps`, or something is not a number."""
    worst = residual(qp, x)
    return Solution(x, y, worst, iterations) if worst <= residual_mps else None
