"""The factor that gains and loses rows is that of the matrix that is left."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gameopt_im.core import envelope
from gameopt_im.core.snapshot import Floats

MOST = 8


@given(st.lists(st.integers(-MOST, MOST), min_size=1, max_size=30), st.integers(0, 2**32), st.integers(0, 3))
def test_whatever_comes_and_goes(steps: list[int], seed: int, reach: int) -> None:
    """A positive step takes in a row that couples with so many variables either way, any other lets one go."""
    random = np.random.default_rng(seed)
    factor, kept = envelope.room_for(MOST), np.zeros((0, 2 * MOST))
    for step in steps:
        if step > 0 and len(kept) < MOST:
            row = near(random, reach)
            v = np.concatenate([kept @ row, np.full(MOST - len(kept), np.nan)])
            coupled = np.flatnonzero(kept @ row)
            begin = int(coupled[0]) if len(coupled) else len(kept)
            left = row @ row - envelope.forward(factor, len(kept), v, begin)
            if left > 1e-6 * (row @ row):
                envelope.append(factor, len(kept), v, begin, left)
                kept = np.vstack([kept, row])
        elif len(kept):
            at = -step % len(kept)
            envelope.remove(factor, len(kept), at)
            kept = np.delete(kept, at, axis=0)
        check(factor, kept, random)


def near(random: np.random.Generator, reach: int) -> Floats:
    """A row that is zero but for a few variables next to each other."""
    row = np.zeros(2 * MOST)
    middle = random.integers(2 * MOST)
    part = slice(max(0, middle - reach), middle + reach + 1)
    row[part] = random.normal(size=len(row[part]))
    return row


def check(factor: envelope.Factor, kept: Floats, random: np.random.Generator) -> None:
    """L L' is the matrix of the rows' products, and both triangles are solved for."""
    size = len(kept)
    lower = np.tril(factor.lower[:size, :size])
    for r in range(size):
        lower[r, : factor.first[r]] = 0.0
    np.testing.assert_allclose(lower @ lower.T, kept @ kept.T, atol=1e-9)
    right = random.normal(size=size)
    x = right.copy()
    square = envelope.forward(factor, size, x, 0)
    np.testing.assert_allclose(lower @ x, right, atol=1e-7)
    assert abs(square - x @ x) <= 1e-9 * (1.0 + square)
    y = x.copy()
    envelope.backward(factor, size, y)
    np.testing.assert_allclose(lower.T @ y, x, rtol=1e-6, atol=1e-6)
