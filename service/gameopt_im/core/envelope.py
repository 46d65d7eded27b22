"""A Cholesky factor L of a matrix that gains and loses rows, kept within its envelope. Compiled.

Row r of L is zero before the first column in which the matrix itself is not: `first` (m,). Rows that couple with few
others, and those near each other, so cost little more than those few.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats, Ints


class Factor(NamedTuple):
    """Room for m rows: L (m, m), of which the lower triangle counts, and where each of its rows begins."""

    lower: Floats
    first: Ints


@kernel
def room_for(m: int) -> Factor:
    """A factor without rows, and room for m."""
    return Factor(np.empty((m, m)), np.empty(m, dtype=np.int64))


@kernel
def forward(factor: Factor, size: int, v: Floats, begin: int) -> float:
    """Solves L x = v in place for the first `size` rows, where v is zero before `begin`; the square of x."""
    lower, first = factor
    square = 0.0
    for r in range(begin, size):
        left = v[r]
        for c in range(max(begin, first[r]), r):
            left -= lower[r, c] * v[c]
        v[r] = left / lower[r, r]
        square += v[r] * v[r]
    return square


@kernel
def backward(factor: Factor, size: int, v: Floats) -> None:
    """Solves L' x = v in place."""
    lower, first = factor
    for r in range(size - 1, -1, -1):
        v[r] /= lower[r, r]
        for c in range(first[r], r):
            v[c] -= lower[r, c] * v[r]


@kernel
def append(factor: Factor, size: int, v: Floats, begin: int, left: float) -> None:
    """One more row: `v` is what `forward` made of its products with those before, `left` its own less v's square."""
    lower, first = factor
    first[size] = begin
    for c in range(begin, size):
        lower[size, c] = v[c]
    lower[size, size] = np.sqrt(left)


@kernel
def remove(factor: Factor, size: int, at: int) -> None:
    """Drops a row: those after it move up, and are turned until each ends on the diagonal again."""
    lower, first = factor
    for r in range(at, size - 1):
        begin = first[r + 1]
        for c in range(begin, r + 2):
            lower[r, c] = lower[r + 1, c]
        if begin > at:  # the turn fills one more
            begin -= 1
            lower[r, begin] = 0.0
        first[r] = begin
    for c in range(at, size - 1):
        length = np.hypot(lower[c, c], lower[c, c + 1])
        cos, sin = lower[c, c] / length, lower[c, c + 1] / length
        lower[c, c] = length
        for r in range(c + 1, size - 1):
            if first[r] <= c:
                here, there = lower[r, c], lower[r, c + 1]
                lower[r, c], lower[r, c + 1] = cos * here + sin * there, cos * there - sin * here
