"""Other solvers on the very programs that the service solves; extras (`pip install 'gameopt[bench]'`), never needed.

Each takes a program as it is built, brings it into the solver's form and is set up for it anew. Clarabel and PIQP are
interior-point methods, which a start from the last control cycle does not help. They are asked for about as much as
OSQP is, not for all that they could reach; DAQP, an active-set method on dense matrices, can only be exact.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from scipy import sparse

from gameopt_im.core.active_set import VIOLATION_MPS
from gameopt_im.core.corridor import FAR_MPS
from gameopt_im.core.program import QP, Sparse
from gameopt_im.core.snapshot import Floats

EXTRA = "pip install 'gameopt[bench]'"
TOLERANCE = 1e-4
"""Of residuals and the gap: what OSQP is asked for on the paper's program; on the horizon's it is asked for 4e-4."""

Solve: TypeAlias = Callable[[QP], Floats]
"""The solution x (nx,) of a program, from scratch; not a number where the solver gives none."""


def installed(name: str) -> str | None:
    """The version of a solver; None where it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def clarabel(qp: QP) -> Floats:
    """Clarabel: rows with a bound become Ax + s = b, s >= 0, upper bounds first."""
    import clarabel as solver

    settings = solver.DefaultSettings()
    settings.verbose = False
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = TOLERANCE
    p, a = _matrix(qp.P), _matrix(qp.A).tocsr()
    upper, lower = qp.u < FAR_MPS, qp.l > -FAR_MPS  # what is so far off would spoil a solver's scaling
    rows = sparse.vstack([a[upper], -a[lower]], format="csc")
    bounds = np.concatenate([qp.u[upper], -qp.l[lower]])
    cones = [solver.NonnegativeConeT(len(bounds))]
    return np.array(solver.DefaultSolver(p, qp.q, rows, bounds, cones, settings).solve().x)


def piqp(qp: QP) -> Floats:
    """PIQP on sparse matrices: l <= Gx <= u is its own form, and it reads the upper triangle of P."""
    import piqp as solver

    lower, upper = np.where(qp.l > -FAR_MPS, qp.l, -np.inf), np.where(qp.u < FAR_MPS, qp.u, np.inf)
    found = solver.SparseSolver()
    found.settings.eps_abs = found.settings.eps_duality_gap_abs = TOLERANCE
    found.settings.eps_rel = found.settings.eps_duality_gap_rel = TOLERANCE
    found.setup(_matrix(qp.P), qp.q, None, None, _matrix(qp.A), lower, upper, None, None)
    found.solve()
    return np.array(found.result.x)


def daqp(qp: QP) -> Floats:
    """DAQP, to as much as the service's own active set: dense matrices, and nothing guessed."""
    import daqp as solver

    upper, a = _matrix(qp.P).toarray(), _matrix(qp.A).toarray()
    sense = np.zeros(len(qp.l), dtype=np.int32)
    x, _, _, _ = solver.solve(upper + np.triu(upper, 1).T, qp.q, a, qp.u, qp.l, sense, primal_tol=VIOLATION_MPS)
    return np.array(x)


OPTIONAL: MappingProxyType[str, Solve] = MappingProxyType({"clarabel": clarabel, "daqp": daqp, "piqp": piqp})
"""By their names in the package index."""


def _matrix(matrix: Sparse) -> Any:
    rows, columns = matrix.shape
    return sparse.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=(rows, columns))
