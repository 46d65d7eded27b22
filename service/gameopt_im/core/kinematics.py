"""How one vehicle moves: the rules of motion, its earliest arrival, and its approach to a slot.

Compiled; scalars in SI units. s is the distance from the front bumper to the stop line, a an acceleration the
plan counts on, b a full deceleration (positive). `Plan` tuples are (cruise speed h, first rate, line speed,
cruise distance, arrival time): brake or accelerate to h, cruise, then accelerate (or brake, for a turn) to the
line speed, which is reached at the line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
from numba.extending import register_jitable

from gameopt_im.core.parameters import Planner
from gameopt_wire import motion

kernel = numba.njit(cache=True, error_model="numpy")
inlined = numba.njit(cache=True, error_model="numpy", inline="always")

for _rule in (
    motion.most_squared,
    motion.brake_speed,
    motion.may_drive,
    motion.reach,
    motion.stop_speed,
    motion.could_stop,
    motion.turn_speed,
    motion.follow_speed,
    motion.tracking_speed,
):
    register_jitable(_rule)

NEVER = 1e9
"""A time or distance that lies beyond every horizon, s or m."""
BISECTIONS = 30
CLOSE_MPS = 1e-9
"""How near a guess of a cruise speed is."""


class Manner(NamedTuple):
    """How vehicles approach: decelerations tried, softest first (m/s^2), a cruise below which they stop (m/s).

    Who has to wait anyway aims at no more than `line_share` of its top speed at the line: the last metres per second
    take the most fuel.
    """

    decels: tuple[float, ...]
    slowest: float
    line_share: float


def manner_of(planner: Planner) -> Manner:
    """The manner of approach from the configuration."""
    return Manner(planner.decels_mps2, planner.min_cruise_mps, planner.line_share)


TOO_SOFT_S = 0.02
"""A deceleration that would arrive this much before the slot is too soft for it."""


@kernel
def final_distance(h: float, line: float, a: float, turn_b: float) -> float:
    """Way from cruise speed h to the line speed, m: accelerating at a, or braking at turn_b before a turn."""
    if h <= line:
        return (line * line - h * h) / (2.0 * a)
    return (h * h - line * line) / (2.0 * turn_b)


@kernel
def peak_speed(s: float, v: float, a: float, top: float, line: float, turn_b: float) -> float:
    """Highest speed on the fastest way to the line: accelerate, then brake to the line speed if it is lower."""
    if line >= top:
        return top
    peak = math.sqrt(max(0.0, (2.0 * a * turn_b * s + turn_b * v * v + a * line * line) / (a + turn_b)))
    return max(line, min(top, peak))


@kernel
def plan_at(
    s: float, v: float, h: float, d: float, a: float, line: float, turn_b: float, aim: float
) -> tuple[float, float, float, float, float]:
    """The plan with cruise speed h and first deceleration d; arrival time -1: d is too soft for s.

    From a slower cruise it accelerates to `aim`, from a faster one it brakes to `line` at most.
    """
    rate = -d if h < v else a
    line = min(line, max(h, aim))
    first = (h * h - v * v) / (2.0 * rate)
    rest = s - first
    if rest < 0.0:
        if h < v:
            return h, rate, v, 0.0, -1.0
        # accelerating all the way and still below h at the line
        end = math.sqrt(v * v + 2.0 * a * max(s, 0.0))
        return end, a, min(end, line), 0.0, (end - v) / a
    time = (h - v) / rate
    need = final_distance(h, line, a, turn_b)
    if need <= rest + 1e-6:
        cruise = max(0.0, rest - need)
        last = (line - h) / a if h <= line else (h - line) / turn_b
        time += last + (cruise / h if h > 0.0 else (0.0 if cruise <= 0.0 else NEVER))
        return h, rate, line, cruise, time
    if h > line:
        return h, rate, h, 0.0, -1.0
    # the line comes before the line speed is reached
    end = math.sqrt(h * h + 2.0 * a * rest)
    return h, rate, end, 0.0, time + (end - h) / a


@kernel
def earliest_arrival(s: float, v: float, a: float, top: float, line: float, turn_b: float) -> tuple[float, float]:
    """(time, line speed) of the fastest way to the line: accelerate, cap at `top`, brake to the turning speed."""
    if s <= 0.0:
        return 0.0, v
    h = max(peak_speed(s, v, a, top, line, turn_b), min(v, top))
    plan = plan_at(s, v, h, turn_b, a, line, turn_b, line)
    if plan[4] < 0.0:
        return s / max(v, 0.1), v
    return plan[4], plan[2]


@kernel
def cruise_speed(s: float, v: float, time: float, end: float, first: float, last: float) -> float:
    """The cruise speed of a way of length s from v to `end` that takes `time`; 0 for none.

    `first`, `last` are s/m/s: what a change of speed takes at the beginning and at the end, negative for braking. From
    (h - v) first + (end - h) last + cruise / h = time, which is quadratic in h.
    """
    p, q = 0.5 * (last - first), time + v * first - end * last
    r = s + 0.5 * v * v * first - 0.5 * end * end * last
    root = q * q + 4.0 * p * r
    if root < 0.0:
        return 0.0
    h = 2.0 * r / (q + math.sqrt(root)) if q >= 0.0 else (math.sqrt(root) - q) / (2.0 * p)
    cruises = time - (h - v) * first - (end - h) * last >= 0.0
    return h if cruises and h > 0.0 else 0.0


@kernel
def turning_point(s: float, v: float, time: float, d: float, a: float) -> float:
    """The lowest speed of a way of length s that takes `time`, braking at d from v, then accelerating at a to its end.

    From (v - h) / d + (end - h) / a = time and end^2 = h^2 + 2 a (s - (v^2 - h^2) / (2 d)); 0 for none.
    """
    k, left = 1.0 + a / d, time - v / d
    p, q, r = k * (k - 1.0), k * a * left, a * a * left * left - 2.0 * a * s + (k - 1.0) * v * v
    root = q * q - p * r
    return max(0.0, (math.sqrt(root) - q) / p) if root > 0.0 else 0.0


@kernel
def cruise_guess(s: float, v: float, time: float, d: float, a: float, line: float, turn_b: float, aim: float) -> float:
    """The cruise speed of the plan that is there at `time`, by the equation of each kind of plan; 0 for none."""
    for first in (-1.0 / d, 1.0 / a):
        for end, last, above, below in (
            (aim, 1.0 / a, 0.0, aim),
            (aim, 0.0, aim, line),
            (line, -1.0 / turn_b, line, NEVER),
        ):
            h = cruise_speed(s, v, time, end, first, last)
            if above < h <= below and (h <= v) == (first < 0.0):
                return h
    return turning_point(s, v, time, d, a)


@kernel
def cruise_for(
    s: float,
    v: float,
    time: float,
    d: float,
    a: float,
    top: float,
    line: float,
    turn_b: float,
    slowest: float,
    aim: float,
) -> tuple[float, float, float, float, float]:
    """The plan that arrives at `time` when first braking at d: h from `cruise_guess`, or else by bisection.

    Arrivals fall as h grows, but not where braking for a turn takes longer than braking now: bisection does there.
    """
    high = max(peak_speed(s, v, a, top, line, turn_b), min(v, top))
    if d <= turn_b or high <= line:
        guess = cruise_guess(s, v, time, d, a, line, turn_b, aim)
        if slowest < guess - CLOSE_MPS and guess + CLOSE_MPS < high:
            plan = plan_at(s, v, guess + CLOSE_MPS, d, a, line, turn_b, aim)
            if 0.0 <= plan[4] <= time and plan_at(s, v, guess - CLOSE_MPS, d, a, line, turn_b, aim)[4] > time:
                return plan
    plan = plan_at(s, v, high, d, a, line, turn_b, aim)
    if plan[4] >= time:
        return plan
    stopped = plan_at(s, v, slowest, d, a, line, turn_b, aim)
    if 0.0 <= stopped[4] <= time:
        # so late a slot that the vehicle stops on the way and waits
        return 0.0, stopped[1], stopped[2], 0.0, stopped[4]
    late, early = slowest, high
    for _ in range(BISECTIONS):
        middle = 0.5 * (late + early)
        plan = plan_at(s, v, middle, d, a, line, turn_b, aim)
        if plan[4] < 0.0 or plan[4] > time:
            late = middle
        else:
            early = middle
    plan = plan_at(s, v, early, d, a, line, turn_b, aim)
    if plan[4] < time - TOO_SOFT_S:
        return plan[0], plan[1], plan[2], plan[3], -1.0
    return plan


@kernel
def approach(
    s: float,
    v: float,
    time: float,
    a: float,
    b: float,
    top: float,
    line: float,
    manner: Manner,
) -> tuple[float, float, float, float, float]:
    """The plan for a slot `time` seconds ahead: wait upstream, arrive fast.

    The softest deceleration that still reaches the line speed aimed at; where none does, the one that reaches the
    highest. Rates are negative when braking.
    """
    aim = min(line, manner.line_share * top)
    turn_b = min(motion.TURN_DECEL_MPS2, b)
    room = max(s - motion.STOP_OFFSET_M - v * v / (2.0 * b), 0.0) + motion.STOP_OFFSET_M
    best = (manner.slowest, -b, min(line, math.sqrt(2.0 * a * room)), 0.0, time)
    best_line = -1.0
    for d in manner.decels:
        plan = cruise_for(s, v, time, min(d, b), a, top, line, turn_b, manner.slowest, aim)
        if plan[4] < 0.0:
            continue
        if plan[2] > best_line + 1e-9:
            best = plan
            best_line = plan[2]
        if plan[2] >= aim - 1e-6:
            break
    return best


@kernel
def approach_speed(
    s: float,
    v: float,
    time: float,
    h: float,
    rate: float,
    a: float,
    top: float,
    line: float,
    turn_b: float,
    dt: float,
) -> float:
    """Speed after the next step on a plan: to h at its rate, at h, and full ahead once the slot asks for it.

    Rule 3 brakes for a turn; the plan only says when to go.
    """
    if has_to_go(s, v, time, a, top, line, turn_b, dt):
        return min(top, v + a * dt)
    return waiting_speed(v, h, rate, a, turn_b, dt)


@kernel
def has_to_go(s: float, v: float, time: float, a: float, top: float, line: float, turn_b: float, dt: float) -> bool:
    """Whether one that goes on for a step as it does comes too late for a slot `time` from now, even full ahead."""
    return earliest_arrival(s - v * dt, v, a, top, line, turn_b)[0] >= time - dt


@kernel
def waiting_speed(v: float, h: float, rate: float, a: float, turn_b: float, dt: float) -> float:
    """Speed after the next step to h at a plan's rate, or at h."""
    if v > h:
        return max(h, v + (rate if rate < 0.0 else -turn_b) * dt)
    return min(h, v + a * dt)


@kernel
def time_past_line(x: float, line: float, a: float, top: float) -> float:
    """Time from the front's crossing of the line to the front x metres past it, s.

    The vehicle crosses at `line` m/s and accelerates at a to `top`.
    """
    if x <= 0.0:
        return x / max(line, 0.1)
    if line >= top:
        return x / max(line, 0.1)
    way = (top * top - line * line) / (2.0 * a)
    if x <= way:
        return (math.sqrt(line * line + 2.0 * a * x) - line) / a
    return (top - line) / a + (x - way) / top
