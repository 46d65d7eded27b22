"""OSQP workspaces that live on: one per sparsity pattern, of which only the values change.

A result depends on the program and the warm start alone, never on what was solved before: the step size rho
is fixed, nothing is rescaled, no clock is read, and every solve starts from the given x and y = 0. One that
is new, reused or made again after it was dropped gives the same bits (`tests/unit/test_workspace.py`).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import osqp
from scipy.sparse import csc_matrix

from gameopt_im.core.program import QP, Csc, Sparse
from gameopt_im.core.snapshot import Floats, Ints


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


def pattern(qp: QP) -> bytes:
    """A key for the sparsity pattern of a program: equal for programs that can share a workspace."""
    return b"".join(
        np.asarray(part, dtype=np.int64).tobytes()
        for part in (qp.A.shape, qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
    )


class Workspace:
    """Solves programs, keeping the OSQP workspaces of the last `capacity` patterns.

    `residual_mps` is the largest primal residual that counts as a solution; the solver is asked for
    `tolerance` times as much.
    `rho` is the fixed step size, to be matched to the size of the multipliers (`program.REAR_END_PENALTY`), `alpha`
    the relaxation. With `unit_rows` the solver sees every row of A at length 1; residuals stay those of A.
    """

    def __init__(
        self,
        *,
        residual_mps: float = 1e-3,
        max_iter: int = 4000,
        rho: float = 100.0,
        alpha: float = 1.6,
        tolerance: float = 0.1,
        capacity: int = 32,
        unit_rows: bool = False,
    ) -> None:
        self._residual_mps = residual_mps
        self._capacity = capacity
        self._unit_rows = unit_rows
        self._settings = {
            "eps_abs": tolerance * residual_mps,
            "eps_rel": 1e-3 * residual_mps,  # of speeds up to 100 m/s: the rest of the residual allowed
            "max_iter": max_iter,
            "rho": rho,
            "alpha": alpha,
            "adaptive_rho": False,
            "scaling": 0,
            "polishing": False,
            "check_dualgap": False,
            "verbose": False,
        }
        self._kept: OrderedDict[Hashable, _Kept] = OrderedDict()

    def solve(self, key: Hashable, qp: QP, warm_start: Floats | None = None) -> Solution | None:
        """The solution of `qp` from `warm_start` (nx,) or zeros, None where none is found.

        Programs under one `key` must have one sparsity pattern: raises ValueError where they do not.
        """
        if np.any(qp.l > qp.u):
            return None
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = _Kept(qp, self._settings, self._unit_rows)
            if len(self._kept) > self._capacity:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(key)
            kept.update(qp)
        x, y, iterations = kept.run(np.zeros(len(qp.q)) if warm_start is None else warm_start)
        residual = kept.residual(qp, x)
        if not residual <= self._residual_mps:  # also where x is not a number
            return None
        return Solution(x, y, kept.objective(qp, x), residual, iterations)


kept_workspace = cache(Workspace)
"""The workspace of these settings in this process: jobs come and go, it stays."""


class _Kept:
    """One OSQP workspace and the pattern it was set up for."""

    def __init__(self, qp: QP, settings: dict[str, Any], unit_rows: bool) -> None:
        self._pattern = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        self._p_column = _columns(qp.P)
        self._a_column = _columns(qp.A)
        self._off_diagonal = 0.5 + 0.5 * (self._p_column != qp.P.indices)
        self._unit_rows = unit_rows
        scale = self._scale = self._row_scale(qp)
        a = Csc((qp.A.shape[0], qp.A.shape[1]), qp.A.data * scale[qp.A.indices], qp.A.indices, qp.A.indptr)
        self._osqp = osqp.OSQP()
        self._osqp.setup(_matrix(qp.P), qp.q, _matrix(a), qp.l * scale, qp.u * scale, **settings)

    def _row_scale(self, qp: QP) -> Floats:
        """What each row of A is multiplied by."""
        if not self._unit_rows:
            return np.ones(qp.A.shape[0])
        squares = np.bincount(qp.A.indices, qp.A.data**2, minlength=qp.A.shape[0])
        return np.asarray(1.0 / np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    def update(self, qp: QP) -> None:
        """Take the values of another program of the same pattern."""
        given = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        if not all(map(np.array_equal, given, self._pattern)):
            raise ValueError("a program with another sparsity pattern under the same key")
        scale = self._scale = self._row_scale(qp)
        self._osqp.update(
            q=qp.q, l=qp.l * scale, u=qp.u * scale, Px=qp.P.data, Ax=qp.A.data * scale[qp.A.indices]
        )  # fmt: skip

    def run(self, start: Floats) -> tuple[Floats, Floats, int]:
        """(x, y, iterations) from `start` and y = 0; x is not a number where the solver gives none."""
        self._osqp.warm_start(x=start, y=np.zeros(self._osqp.m))
        result = self._osqp.solve(raise_error=False)
        y = np.array(result.y, dtype=np.float64) * self._scale
        return np.array(result.x, dtype=np.float64), y, int(result.info.iter)

    def residual(self, qp: QP, x: Floats) -> float:
        """Largest violation of l <= Ax <= u, computed apart from the solver."""
        ax = np.bincount(qp.A.indices, qp.A.data * x[self._a_column], minlength=qp.A.shape[0])
        return float(np.max(np.maximum(qp.l - ax, ax - qp.u), initial=0.0))

    def objective(self, qp: QP, x: Floats) -> float:
        """1/2 x'Px + q'x + constant; P holds only one of each two equal entries off the diagonal."""
        half = self._off_diagonal * qp.P.data * x[qp.P.indices] * x[self._p_column]
        return float(half.sum() + (qp.q * x).sum() + qp.constant)


def _columns(matrix: Sparse) -> Ints:
    return np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.indptr))


def _matrix(matrix: Sparse) -> csc_matrix[np.float64]:
    return csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=(matrix.shape[0], matrix.shape[1]))
