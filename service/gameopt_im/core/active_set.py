"""A platoon's horizon program by a dual active-set method (Goldfarb and Idnani 1983) that knows how its rows are made.

Theory of operation. In least-distance form (`least_distance`) the program is min 1/2 |z + f|^2 with g z <= b for every
row and bound. If the rows of a working set W bind, z = -f - sum_w lambda_w g_w, where G G' lambda = -(b + G f). The
method goes from one working set whose multipliers are none of them negative to the next:

    begin     with the rows guessed to bind, less those that depend on others, less those of a negative multiplier
    violated  the most violated row is added: its multiplier grows, and those of the others change with it, until it
              is kept (a full step), or until another's is zero, whose row is dropped (a partial one)
    done      when no row is violated: the program is convex, so that is its optimum

G G' is zero but for rows of one vehicle and the next, and its factor keeps to that envelope. From one control cycle to
the next hardly any row begins or ceases to bind, so from the last winner's multipliers it is a matter of few steps. A
result depends on the program and the guess alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core import envelope, horizon, least_distance
from gameopt_im.core.corridor import FAR_MPS
from gameopt_im.core.envelope import Factor
from gameopt_im.core.horizon import BOUND, MULTIPLIER, column_of
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats, Ints

STEPS = 1000
"""Rows added or dropped, at the most: 263 were seen, from no guess at all."""
VIOLATION_MPS = 1e-9
"""Of a row that still counts as kept."""
DEPENDENT = 1e-10
"""Share of a row's square beyond which it is no sum of others."""


class PlatoonSolution(NamedTuple):
    """Speeds at the ends of the blocks (n, H), multipliers (n, 4, H), and the largest violation of a row, m/s.

    A multiplier is positive where a row is at its upper bound. `steps` are the iterations of whatever solved it.
    """

    u: Floats
    duals: Floats
    residual: float
    steps: int


class WorkingSet(NamedTuple):
    """The rows that bind: vehicle, kind and block, 1 at the upper bound or -1 at the lower, that bound, lambda."""

    vehicle: Ints
    kind: Ints
    block: Ints
    sign: Floats
    bound: Floats
    multiplier: Floats


def solve(values: Floats, blocks: tuple[float, ...], residual_mps: float) -> PlatoonSolution | None:
    """The solution of the program that is `values` of `horizon.build`; None where none is found.

    `residual_mps` is the largest violation of a row, worked out apart from the method, that counts as a solution.
    """
    way = horizon.mean_speeds(blocks)
    done, u, duals, steps = _solve(values, way, STEPS)
    residual = horizon.violation(values, u, way)
    return PlatoonSolution(u, duals, residual, steps) if done and residual <= residual_mps else None


@kernel
def _solve(values: Floats, way: Floats, most: int) -> tuple[bool, Floats, Floats, int]:
    n, h = values.shape[0], way.shape[0]
    factors = least_distance.inverse_factors(values, h)
    rows, f = least_distance.own_rows(factors, way), least_distance.linear(factors, values)
    working, factor, size = _guessed(rows, values)
    z, steps, done = np.empty((n, h)), 0, False
    while not done and steps <= most:  # after any step once more: multipliers anew, not what steps have added up to
        size, dropped = _without_negative(rows, f, working, factor, size)
        _point(rows, f, working, size, z)
        size, taken = _complete(rows, f, values, working, factor, size, z, most - steps)
        steps, done = steps + dropped + taken, taken == 0
    duals = np.zeros((n, 4, h))
    for w in range(size):
        duals[working.vehicle[w], working.kind[w], working.block[w]] = working.sign[w] * working.multiplier[w]
    return done, least_distance.speeds(factors, z), duals, steps


@kernel
def _guessed(rows: Floats, values: Floats) -> tuple[WorkingSet, Factor, int]:
    """The rows with a multiplier in `values` that depend on no other, and how many: at most as many as variables."""
    n, h = rows.shape[0], rows.shape[2]
    place, number = np.empty((3, n * h), dtype=np.int64), np.empty((3, n * h))
    working = WorkingSet(place[0], place[1], place[2], number[0], number[1], number[2])
    factor, size, v = envelope.room_for(n * h), 0, np.empty(n * h)
    for i in range(n):
        for kind in range(4 if i > 0 else 3):
            for k in range(h):
                guess = values[i, column_of(h, kind, k) + MULTIPLIER * h]
                if not (guess > 0.0 or guess < 0.0) or size == n * h:
                    continue
                sign = 1.0 if guess > 0.0 else -1.0
                if _bound(values, h, i, kind, k, sign) >= FAR_MPS:
                    continue
                own = least_distance.product(rows, i, kind, k, i, kind, k)
                begin = _products(rows, working, size, i, kind, k, sign, v)
                left = own - envelope.forward(factor, size, v, begin)
                if left > DEPENDENT * own:
                    _add(values, h, working, factor, size, i, kind, k, sign, v, begin, left)
                    size += 1
    return working, factor, size


@kernel
def _without_negative(rows: Floats, f: Floats, working: WorkingSet, factor: Factor, size: int) -> tuple[int, int]:
    """Drops rows of a negative multiplier until there are none; how many are left, and how many it dropped."""
    dropped = 0
    while True:
        lam = working.multiplier
        for w in range(size):
            g_f = least_distance.value(rows, f, working.vehicle[w], working.kind[w], working.block[w])
            lam[w] = -working.bound[w] - working.sign[w] * g_f
        envelope.forward(factor, size, lam, 0)
        envelope.backward(factor, size, lam)
        before = size
        for w in range(size - 1, -1, -1):
            if lam[w] < 0.0:
                _drop(working, factor, size, w)
                size -= 1
        if size == before:
            return size, dropped
        dropped += before - size


@kernel
def _complete(
    rows: Floats, f: Floats, values: Floats, working: WorkingSet, factor: Factor, size: int, z: Floats, most: int
) -> tuple[int, int]:
    """Adds what z violates, until it violates nothing; how many rows bind then, and the steps it took.

    More than `most` steps where it gives up.
    """
    h, steps = rows.shape[2], 0
    lam, v, change = working.multiplier, np.empty(len(working.sign)), np.empty(len(working.sign))
    i, kind, k, sign, over = least_distance.most_violated(rows, values, z)
    while over > VIOLATION_MPS:
        own, grown = least_distance.product(rows, i, kind, k, i, kind, k), 0.0
        added = False
        while not added:
            steps += 1
            begin = _products(rows, working, size, i, kind, k, sign, v)
            left = own - envelope.forward(factor, size, v, begin)
            for w in range(size):
                change[w] = v[w]
            envelope.backward(factor, size, change)
            free = left > DEPENDENT * own and size < len(lam)
            full, partial, at = over / left if free else np.inf, np.inf, -1
            for w in range(size):
                if change[w] > 0.0 and lam[w] < partial * change[w]:
                    partial, at = lam[w] / change[w], w
            step = min(full, partial)
            if not step < np.inf or steps > most:
                return size, most + 1
            for w in range(size):
                lam[w] -= step * change[w]
            grown += step
            added = full <= partial
            if added:
                _add(values, h, working, factor, size, i, kind, k, sign, v, begin, left)
                lam[size] = grown
                size += 1
            else:
                over -= step * left if free else 0.0
                _drop(working, factor, size, at)
                size -= 1
        _point(rows, f, working, size, z)
        i, kind, k, sign, over = least_distance.most_violated(rows, values, z)
    return size, steps


@kernel
def _point(rows: Floats, f: Floats, working: WorkingSet, size: int, z: Floats) -> None:
    """z = -f - sum_w lambda_w g_w."""
    for i in range(z.shape[0]):
        for m in range(z.shape[1]):
            z[i, m] = -f[i, m]
    for w in range(size):
        times = working.sign[w] * working.multiplier[w]
        least_distance.subtract(rows, z, times, working.vehicle[w], working.kind[w], working.block[w])


@kernel
def _products(rows: Floats, working: WorkingSet, size: int, i: int, kind: int, k: int, sign: float, v: Floats) -> int:
    """Writes a row's products with those that bind to v; where they begin, up to where all are zero."""
    begin = size
    for w in range(size - 1, -1, -1):
        v[w] = 0.0
        if abs(working.vehicle[w] - i) <= 1:
            v[w] = least_distance.product(rows, working.vehicle[w], working.kind[w], working.block[w], i, kind, k)
            v[w] *= sign * working.sign[w]
            if v[w] != 0.0:
                begin = w
    return begin


@kernel
def _add(
    values: Floats, h: int, working: WorkingSet, factor: Factor, size: int,
    i: int, kind: int, k: int, sign: float, v: Floats, begin: int, left: float,
) -> None:  # fmt: skip
    envelope.append(factor, size, v, begin, left)
    working.vehicle[size], working.kind[size], working.block[size] = i, kind, k
    working.sign[size], working.bound[size] = sign, _bound(values, h, i, kind, k, sign)


@kernel
def _drop(working: WorkingSet, factor: Factor, size: int, at: int) -> None:
    envelope.remove(factor, size, at)
    for w in range(at, size - 1):
        working.vehicle[w], working.kind[w] = working.vehicle[w + 1], working.kind[w + 1]
        working.block[w], working.sign[w] = working.block[w + 1], working.sign[w + 1]
        working.bound[w], working.multiplier[w] = working.bound[w + 1], working.multiplier[w + 1]


@kernel
def _bound(values: Floats, h: int, i: int, kind: int, k: int, sign: float) -> float:
    """b of g z <= b."""
    column = column_of(h, kind, k)
    bound: float = values[i, column + BOUND * h] if sign > 0.0 else -values[i, column]
    return bound
