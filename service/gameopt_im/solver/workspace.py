"""OSQP workspaces that live on: one per sparsity pattern, of which only the values change.

A result depends on the program and the warm start alone, never on what was solved before: the step size rho
is fixed, nothing is rescaled, no clock is read, and every solve starts from the given x and no multipliers. One that is
new, reused or made again after it was dropped gives the same bits (`tests/unit/test_workspace.py`).
"""

from __future__ import annotations

import signal
from collections import OrderedDict
from collections.abc import Hashable, Mapping
from functools import cache
from typing import Any

import numpy as np
from osqp import ext_builtin as osqp
from scipy.sparse import csc_matrix

from gameopt_im.core.program import QP, Sparse
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.solution import Solution, checked

INFINITE: float = osqp.OSQP_INFTY
"""A bound this large is none."""


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
        lengths: Floats | None = None,
    ) -> Solution | None:
        """The solution of `qp` from `start` (nx,) or zeros, None where none is found.

        The solver sees the rows of A at these `lengths` (m,): the longer, the sooner it keeps to them. Residuals stay
        those of A. Programs under one `key` must have one sparsity pattern, or it raises ValueError, and one `lengths`.
        """
        if (qp.l > qp.u).any():
            return None
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = _Kept(qp, self._settings, lengths)
            if len(self._kept) > self._capacity:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(key)
            kept.update(qp)
        x, y, iterations = kept.run(np.zeros(len(qp.q)) if start is None else start)
        return checked(qp, x, y, iterations, self._residual_mps)


kept_workspace = cache(Workspace)
"""The workspace of these settings in this process: jobs come and go, it stays."""


class _Kept:
    """One OSQP workspace and the pattern it was set up for.

    The solver's own binding is called: the wrapper around it takes longer than a small program does.
    """

    def __init__(self, qp: QP, settings: Mapping[str, Any], lengths: Floats | None) -> None:
        self._pattern = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        self._lengths = lengths
        self._a, self._p = qp.A, qp.P.data.copy()
        self._scale = self._row_scale(qp)
        given = osqp.OSQPSettings()
        osqp.osqp_set_default_settings(given)
        for name, value in settings.items():
            setattr(given, name, value)
        a = _matrix(qp.A, qp.A.data * self._scale[qp.A.indices])
        rows, columns = qp.A.shape
        p = _matrix(qp.P, qp.P.data)
        self._solver = osqp.OSQPSolver(p, qp.q, a, *self._bounds(qp), rows, columns, given)

    def _row_scale(self, qp: QP) -> Floats:
        """What each row of A is multiplied by."""
        if self._lengths is None:
            return np.ones(qp.A.shape[0])
        squares = np.bincount(qp.A.indices, qp.A.data**2, minlength=qp.A.shape[0])
        return np.asarray(self._lengths / np.sqrt(np.where(squares > 0.0, squares, 1.0)))

    def _bounds(self, qp: QP) -> tuple[Floats, Floats]:
        """l and u of the scaled rows; what is infinite is so for the solver, too."""
        return np.maximum(qp.l * self._scale, -INFINITE), np.minimum(qp.u * self._scale, INFINITE)

    def update(self, qp: QP) -> None:
        """Take the values of another program of the same pattern; matrices that stay are not factorised again."""
        given = (qp.P.indptr, qp.P.indices, qp.A.indptr, qp.A.indices)
        if not all(one is other or np.array_equal(one, other) for one, other in zip(given, self._pattern, strict=True)):
            raise ValueError("a program with another sparsity pattern under the same key")
        p = a = None
        if qp.A is not self._a:
            self._a, self._scale = qp.A, self._row_scale(qp)
            a = qp.A.data * self._scale[qp.A.indices]
        if (qp.P.data != self._p).any():
            self._p = p = qp.P.data.copy()
        low, high = self._bounds(qp)
        self._solver.update_data_vec(q=qp.q, l=low, u=high)
        if p is not None or a is not None:
            self._solver.update_data_mat(P_x=p, P_i=None, A_x=a, A_i=None)

    def run(self, start: Floats) -> tuple[Floats, Floats, int]:
        """(x, y, iterations) from `start`; x is not a number where the solver gives none."""
        self._solver.warm_start(start, np.zeros(len(self._scale)))
        self._solver.solve()
        if self._solver.info.status_val == osqp.osqp_status_type.OSQP_SIGINT.value:
            signal.raise_signal(signal.SIGINT)  # the solver caught it: it is somebody else's to answer
        found = self._solver.solution  # x and y are the solver's own memory
        return np.array(found.x), found.y * self._scale, int(self._solver.info.iter)


def _matrix(matrix: Sparse, data: Floats) -> Any:
    return osqp.CSC(csc_matrix((data, matrix.indices, matrix.indptr), shape=(matrix.shape[0], matrix.shape[1])))
