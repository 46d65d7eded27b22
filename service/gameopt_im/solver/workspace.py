"""OSQP workspaces that live on: one per sparsity pattern, of which only the values change.

A result depends on the program and the warm start alone, never on what was solved before: the step size rho
is fixed, nothing is rescaled, no clock is read, and every solve starts from the given x and y. One that is
new, reused or made again after it was dropped gives the same bits (`tests/unit/test_workspace.py`).
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
    the relaxation; whether it is done is asked every `check` iterations.
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
        check: int = 25,
    ) -> None:
        self._residual_mps = residual_mps
        self._capacity = capacity
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
            "check_termination": check,
            "verbose": False,
        }
        self._kept: OrderedDict[Hashable, _Kept] = OrderedDict()

    def solve(
        self,
        key: Hashable,
        qp: QP,
        start: Floats | None = None,
        duals: Floats | None = None,
        lengths: Floats | None = None,
    ) -> Solution | None:
        """The solution of `qp` from `start` (nx,) and `duals` (m,) or zeros, None where none is found.

        The solver sees the rows of A at these `lengths` (m,): the longer, the sooner it keeps to them. Residuals stay
        those of A. Programs under one `key` must have one sparsity pattern, or it raises ValueError, and one `lengths`.
        """
        if np.any(qp.l > qp.u):
            return None
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = _Kept(qp, self._settings, lengths)
            if len(self._kept) > self._capacity:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(key)
            kept.update(qp)
        x, y, iterations = kept.run(
            np.zeros(len(qp.q)) if start is None else start, np.zeros(len(qp.l)) if duals is None else duals
        )
        residual = kept.residual(qp, x)
        if not residual <= self._residual_mps:  # also where x is not a number
            return None
        return Solution(x, y, kept.objective(qp, x), residual, iterations)


kept_workspace = cache(Workspace)
"""The workspace of these settings in this process: jobs come and go, it stays."""


class _Kept:
    """One OSQP workspace and the pattern it was set up for."""

    def __init__(self, qp: QP, settings: dict[str, Any], lengths: Floats | None) -> None:
        self._pattern = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        self._p_column = _columns(qp.P)
        self._a_column = _columns(qp.A)
        self._off_diagonal = 0.5 + 0.5 * (self._p_column != qp.P.indices)
        self._lengths = lengths
        self._a, self._p = qp.A, qp.P.data.copy()
        self._scale = self._row_scale(qp)
        a = Csc((qp.A.shape[0], qp.A.shape[1]), qp.A.data * self._scale[qp.A.indices], qp.A.indices, qp.A.indptr)
        self._osqp = osqp.OSQP()
        self._osqp.setup(_matrix(qp.P), qp.q, _matrix(a), qp.l * self._scale, qp.u * self._scale, **settings)

    def _row_scale(self, qp: QP) -> Floats:
        """What each row of A is multiplied by."""
        if self._lengths is None:
            return np.ones(qp.A.shape[0])
        squares = np.bincount(qp.A.indices, qp.A.data**2, minlength=qp.A.shape[0])
        return np.asarray(self._lengths / np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    def update(self, qp: QP) -> None:
        """Take the values of another program of the same pattern; matrices that stay are not factorised again."""
        given = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        if not all(one is other or np.array_equal(one, other) for one, other in zip(given, self._pattern, strict=True)):
            raise ValueError("a program with another sparsity pattern under the same key")
        changed = {}
        if qp.A is not self._a:
            self._a, self._scale = qp.A, self._row_scale(qp)
            changed["Ax"] = qp.A.data * self._scale[qp.A.indices]
        if not np.array_equal(qp.P.data, self._p):
            self._p = changed["Px"] = qp.P.data.copy()
        self._osqp.update(q=qp.q, l=qp.l * self._scale, u=qp.u * self._scale, **changed)

    def run(self, start: Floats, duals: Floats) -> tuple[Floats, Floats, int]:
        """(x, y, iterations) from `start` and `duals`; x is not a number where the solver gives none."""
        self._osqp.warm_start(x=start, y=duals / self._scale)
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
