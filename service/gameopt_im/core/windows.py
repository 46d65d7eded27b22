"""When a body occupies which conflict area, and whether two of them come too near each other there.

Ways x are metres of the front bumper past the stop line, sampled every STEP_S.
"""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.snapshot import Floats
from gameopt_wire.messages import STEP_S

HORIZON = 320
"""Steps of a way: 32 s. A crossing that takes longer is not granted."""


@kernel
def step_at(start: int, cycle: int) -> int:
    """The index of a control cycle in the arrays of a way that begins with control cycle `start`."""
    return min(max(cycle - start, 0), HORIZON - 1)


@kernel
def crossing_time(x: Floats, start: int, cycle: int) -> float:
    """When the front crosses the line on a way from control cycle `start`, s from another; negative once it has."""
    k = np.searchsorted(x, 0.0)
    if k == 0 or k >= x.shape[0]:
        return -step_at(start, cycle) * STEP_S
    before, after = x[k - 1], x[k]
    part = -before / (after - before) if after > before else 0.0
    return float((k - 1 + part - (cycle - start)) * STEP_S)


@kernel
def time_at(x: Floats, first: int, distance: float) -> float:
    """Time from step `first` at which x reaches `distance`, s; 0 if it is already past, NEVER if it never does."""
    last = x.shape[0] - 1
    if x[first] >= distance:
        return 0.0
    if x[last] < distance:
        return NEVER
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] >= distance:
            high = middle
        else:
            low = middle
    step = x[high] - x[low]
    return float((low - first + (distance - x[low]) / step) * STEP_S)


@kernel
def speed_at(x: Floats, first: int, time: float) -> float:
    """Mean speed over the step that `time` (s after step `first`) falls into, m/s."""
    k = min(first + int(time / STEP_S), x.shape[0] - 2)
    return float(max((x[k + 1] - x[k]) / STEP_S, 0.05))


@kernel
def occupancy(
    x: Floats, late_x: Floats, first: int, length: float, entry: float, leave: float
) -> tuple[float, float, float, float]:
    """(in, out, speed in, speed out) of a body on one conflict area: seconds from step `first`, m/s.

    In: the nominal front at `entry`; out: the worst-case rear at `leave`. Out is negative once it has left.
    """
    if late_x[first] - length >= leave:
        return -1.0, -1.0, NEVER, NEVER
    t_in = time_at(x, first, entry)
    t_out = time_at(late_x, first, leave + length)
    return t_in, t_out, speed_at(x, first, t_in), speed_at(late_x, first, min(t_out, 1e3))


@kernel
def overlap(
    mine: tuple[float, float, float, float],
    other: tuple[float, float, float, float],
    margin_s: float,
    margin_m: float,
) -> float:
    """How much later I would have to come for the two windows to be disjoint with their margin, s; 0 if they are.

    The margin is the larger of margin_s and the time either vehicle takes for margin_m.
    """
    if other[1] < 0.0 or mine[1] < 0.0:
        return 0.0
    after = max(margin_s, margin_m / mine[2], margin_m / other[3])
    before = max(margin_s, margin_m / other[2], margin_m / mine[3])
    if mine[0] >= other[1] + after or other[0] >= mine[1] + before:
        return 0.0
    return other[1] + after - mine[0]
