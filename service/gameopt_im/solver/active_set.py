"""A platoon's program by DAQP, a dual active-set method: soon done from a good guess of what binds.

From one control cycle to the next hardly any row begins or ceases to bind, so most often a handful of steps leads from
the last winner's multipliers to the solution; a first-order method goes the same way in a hundred. A result depends on
the program and the guess alone: nothing is kept but memory.
"""

from __future__ import annotations

from functools import lru_cache

import daqp
import numpy as np

from gameopt_im.core import horizon, least_distance
from gameopt_im.core.horizon import Programmed
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.solution import Solution, checked

STEPS = 500
"""Rows begun or ceased to bind, at the most, or as many as there are rows: 175 were seen, from guesses at random."""
VIOLATION = 1e-9
"""Of a row of length 1 that DAQP still takes for kept."""
OPTIMAL = 1
"""DAQP's flag of a solution."""


def solve(given: Programmed, blocks: tuple[float, ...], residual_mps: float) -> Solution | None:
    """The solution, where the rows with a multiplier in `given` are tried first; None where none is found.

    `residual_mps` is the largest violation of a row, worked out apart from the solver, that counts as a solution.
    """
    qp, h = given.qp, len(blocks)
    factors = least_distance.inverse_factors(qp.P.data, h)
    identity, rows = _buffers(len(factors), h)
    f = least_distance.transformed(factors, qp.q, horizon.mean_speeds(blocks), rows)
    guess = least_distance.working_set(given.y, qp.l, qp.u)
    most = max(STEPS, len(guess))
    z, _, flag, info = daqp.solve(identity, f, rows, qp.u, qp.l, guess, iter_limit=most, primal_tol=VIOLATION)
    if flag != OPTIMAL:
        return None
    return checked(qp, least_distance.speeds(factors, z), info["lam"], info["iterations"], residual_mps)


@lru_cache(maxsize=64)
def _buffers(n: int, h: int) -> tuple[Floats, Floats]:
    """The identity as cost, and zeros for the rows: which of them are written depends on n and H alone.

    For one thread of a process, since all programs of a size share them.
    """
    return np.eye(n * h), np.zeros(((4 * n - 1) * h, n * h))
