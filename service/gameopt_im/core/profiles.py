"""Complete speed profiles through the conflict zone, and when they occupy which conflict area.

Positions x are metres of the front bumper past the stop line (x = -s), sampled every STEP_S from the control
cycle a profile was made in. Every array is HORIZON steps long: past its end a profile goes on at its last speed. The
worst case begins with a standing vehicle where the sight on the exit ends; everyone before it brakes as rule 2
makes it, and slows down to open its headway once it is clear.
"""

from __future__ import annotations

import math

import numpy as np

from gameopt_im.core.kinematics import NEVER, Manner, approach, approach_speed, kernel
from gameopt_im.core.snapshot import Floats
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

HORIZON = 320
"""Steps of a profile: 32 s. A crossing that takes longer is not granted."""
RULE_TOLERANCE_MPS = 1e-6
"""A vehicle that rides a rule's curve exactly is not past it."""
STOP_PLAY_M = 0.03
"""A stop that ends within a step goes up to b dt^2 / 8 too far; rule 2 is failed only by more than this."""


@kernel
def follow(
    x: float, v: float, b: float, k: int, lead_room: Floats, lead_v: Floats, lead_b: Floats
) -> tuple[float, bool]:
    """(rule 2 at step k behind every leader, m/s; whether it can be kept by braking fully)."""
    u, possible = NEVER, True
    floor = v - b * STEP_S
    for m in range(lead_b.shape[0]):
        if lead_room[m, k] >= NEVER:
            continue
        gap = lead_room[m, k] - x
        rule = motion.follow_speed(gap, v, b, lead_v[m, k], lead_b[m], STEP_S)
        if rule < floor and motion.follow_speed(gap + STOP_PLAY_M, v, b, lead_v[m, k], lead_b[m], STEP_S) < floor:
            possible = False
        u = min(u, rule)
    return u, possible


@kernel
def drive(
    x0: float,
    v0: float,
    slot: float,
    body: tuple[float, float, float, float, float],
    way: tuple[float, float, float, float, float],
    manner: Manner,
    lead_room: Floats,
    lead_v: Floats,
    lead_b: Floats,
    x: Floats,
    v: Floats,
) -> int:
    """Drive from (x0, v0) over the line at `slot` and through the zone, under rules 2 and 3; fills x and v.

    body = (length, planned acceleration, deceleration, top speed upstream, top speed on the exit).
    way = (turning speed or NEVER, path length over the zone, distance at which the rear stands clear, line speed
    cap, slot-less flag > 0 for full ahead).
    lead_room (m, steps) is where each leader's rear is less the standing gap, in this vehicle's x; lead_v its
    speed, lead_b (m,) its deceleration. After the rear is clear the vehicle keeps its speed.
    Returns the step at which the rear is clear, or -1 where rule 2 cannot be kept or the way takes too long.
    """
    length, a, b, top, exit_top = body
    turn, path, clear, cap, ahead = way
    turn_b = min(motion.TURN_DECEL_MPS2, b)
    h, rate = top, a
    if ahead <= 0.0 and x0 < 0.0:
        plan = approach(-x0, v0, slot, a, b, top, cap, manner)
        h, rate = plan[0], plan[1]
    x[0], v[0] = x0, v0
    done = -1
    for k in range(x.shape[0] - 1):
        s = -x[k]
        if done >= 0:
            u = v[k]
        else:
            limit = top if s > 0.0 else exit_top
            if s > 0.0:
                limit = min(limit, motion.turn_speed(s, v[k], b, STEP_S, turn))
            elif x[k] < path:
                limit = min(limit, turn)
            if ahead <= 0.0 and s > 0.0:
                u = approach_speed(s, v[k], slot - k * STEP_S, h, rate, a, top, cap, turn_b, STEP_S)
            else:
                u = v[k] + a * STEP_S
            u = min(u, limit)
        rule, possible = follow(x[k], v[k], b, k, lead_room, lead_v, lead_b)
        if done < 0 and not possible:
            return -1
        u = max(0.0, min(u, rule), v[k] - b * STEP_S)
        v[k + 1] = u
        x[k + 1] = x[k] + 0.5 * STEP_S * (v[k] + u)
        if done < 0 and x[k + 1] - length >= clear and x[k + 1] >= path:
            done = k + 1
    return done


@kernel
def held_back(
    x0: float,
    v0: float,
    v: Floats,
    first: int,
    body: tuple[float, float, float],
    clear: float,
    ahead: tuple[float, float, float],
    lead_room: Floats,
    lead_v: Floats,
    lead_b: Floats,
    late_x: Floats,
    late_v: Floats,
) -> int:
    """The worst case from (x0, v0) at step `first` on: every leader at its own worst; fills late_x, late_v from there.

    The vehicle keeps to its profile's speeds v as far as rule 2 lets it. Once its rear is clear it may slow down to
    open its headway, and have to stop where the sight on its exit ends: `ahead` = (deceleration and lowest speed of
    the exit law, end of sight). body = (length, acceleration,
    deceleration); leaders as in `drive`, from step `first` on.
    Returns the step at which the rear is clear, -1 if it never is or rule 2 cannot be kept.
    """
    length, a, b = body
    late_x[first], late_v[first] = x0, v0
    done = first if x0 - length >= clear else -1
    for k in range(first, v.shape[0] - 1):
        rule, possible = follow(late_x[k], late_v[k], b, k - first, lead_room, lead_v, lead_b)
        if done < 0 and not possible:
            return -1
        u = min(v[k + 1], late_v[k] + a * STEP_S)
        if done >= 0:
            u = min(late_v[k], max(ahead[1], late_v[k] - ahead[0] * STEP_S))
            u = min(u, motion.brake_speed(ahead[2] - late_x[k], late_v[k], b, STEP_S, 0.0))
        u = max(0.0, late_v[k] - b * STEP_S, min(u, rule))
        late_v[k + 1] = u
        late_x[k + 1] = late_x[k] + 0.5 * STEP_S * (late_v[k] + u)
        if done < 0 and late_x[k + 1] - length >= clear:
            done = k + 1
    return done


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


def resting(x0: float, v0: float, b: float, brake: bool) -> tuple[Floats, Floats]:
    """The way of a vehicle that has no profile: on at its speed, or braking fully from now. (x, v) arrays."""
    times: Floats = np.arange(HORIZON, dtype=np.float64) * STEP_S
    if not brake:
        return x0 + v0 * times, np.full(HORIZON, v0)
    moving = np.minimum(times, v0 / b)
    return np.asarray(x0 + v0 * moving - 0.5 * b * moving**2), np.asarray(np.maximum(0.0, v0 - b * times))


def clear_time(x: Floats, distance: float) -> float:
    """Time at which x first reaches `distance`, s; infinite if it never does."""
    time = float(time_at(x, 0, distance))
    return math.inf if time >= NEVER else time
