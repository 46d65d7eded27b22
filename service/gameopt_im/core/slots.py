"""Slots: when each uncleared vehicle crosses its stop line.

A vehicle's slot is the first time that respects its own earliest arrival, its leader's slot and a headway, and
every conflicting window already placed. Times in s from the snapshot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import NEVER, Manner, approach, earliest_arrival, kernel, time_past_line
from gameopt_im.core.snapshot import Floats, Ints
from gameopt_wire import motion

SETTLE_ROUNDS = 400
SAME_S = 1e-9
"""Slots this close are the same, s."""
SLOWEST_MPS = 0.5
"""Line speeds are counted as this at least, m/s."""


class Demand(NamedTuple):
    """The uncleared vehicles of one control cycle, and what they have to fit around; n of them in L lanes.

    `queue` (L, q) holds their indices front to back, padded with -1; `floor` (L,) is the earliest slot behind
    the last cleared vehicle of the lane; `arrival` (n,) breaks ties.
    `windows` (M, F, M, F, 2) are the map's conflict windows.
    `blocked` (n, R, 4) holds, for each reservation met, its window (in, out) and where the vehicle's front
    enters and has to be to have left; NaN where they do not meet.
    """

    s: Floats
    v: Floats
    length: Floats
    a: Floats
    b: Floats
    top: Floats
    line_cap: Floats
    cross_top: Floats
    movement: Ints
    footprint: Ints
    lane: Ints
    queue: Ints
    arrival: Ints
    floor: Floats
    windows: Floats
    blocked: Floats


class Rules(NamedTuple):
    """The planner's margins: seconds, metres per speed, headway; how an approach is driven; the weight of `hold`."""

    margin_s: float
    margin_m: float
    extra_s: float
    headway_s: float
    manner: Manner
    hold_weight: float


class Course(NamedTuple):
    """What the candidates of a control cycle share, worked out once: n vehicles of C kinds, a movement and a body each.

    `cars` (n, 10) holds a `Car` a row, `exit_m` (n,) where the vehicle has left the last ground that others want, 0
    where there is none. `kind` (n,) indexes `ground` (C, C, 4): where the first kind enters and leaves what it shares
    with the second, and where that one does, m; NaN where they do not meet.
    `met` (B, 4) holds the rows of `Demand.blocked` where they meet, vehicle i's from `since[i]` to `since[i + 1]`,
    the last to end first (`until`).
    """

    cars: Floats
    exit_m: Floats
    kind: Ints
    ground: Floats
    since: Ints
    met: Floats


class Car(NamedTuple):
    """One vehicle as numbers, which kernels hand on faster than many arrays; `first`, `line`: its earliest arrival."""

    s: float
    v: float
    length: float
    a: float
    b: float
    top: float
    line_cap: float
    cross_top: float
    first: float
    line: float


B = Car._fields.index("b")


@kernel
def course_of(demand: Demand) -> Course:
    """The course of a demand."""
    n, bodies = demand.s.shape[0], demand.windows.shape[1]
    cars, exit_m = np.empty((n, 10)), np.zeros(n)
    kind, since = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    named = np.full(demand.windows.shape[0] * bodies, -1)
    movement, footprint = np.empty(n, np.int64), np.empty(n, np.int64)
    met = np.empty((demand.blocked.shape[0] * demand.blocked.shape[1], 4))
    kinds = rows = 0
    for i in range(n):
        s, v, a, b, top, cap = demand.s[i], demand.v[i], demand.a[i], demand.b[i], demand.top[i], demand.line_cap[i]
        first, line = earliest_arrival(s, v, a, top, cap, min(motion.TURN_DECEL_MPS2, b))
        row = (s, v, demand.length[i], a, b, top, cap, demand.cross_top[i], first, line)
        for field in range(len(row)):
            cars[i, field] = row[field]
        name = demand.movement[i] * bodies + demand.footprint[i]
        if named[name] < 0:
            named[name] = kinds
            movement[kinds], footprint[kinds] = demand.movement[i], demand.footprint[i]
            kinds += 1
        kind[i] = named[name]
        for m in range(demand.windows.shape[2]):
            leave = demand.windows[demand.movement[i], demand.footprint[i], m, demand.footprint[i], 1]
            if leave > -NEVER:  # false for NaN
                exit_m[i] = max(exit_m[i], leave)
        for r in range(demand.blocked.shape[1]):
            if demand.blocked[i, r, 1] > -NEVER:
                place = rows
                while place > since[i] and until(met[place - 1]) < until(demand.blocked[i, r]):
                    met[place] = met[place - 1]
                    place -= 1
                met[place] = demand.blocked[i, r]
                rows += 1
        since[i + 1] = rows
    ground = np.empty((kinds, kinds, 4))
    for c in range(kinds):
        for d in range(kinds):
            ground[c, d, :2] = demand.windows[movement[c], footprint[c], movement[d], footprint[d]]
            ground[c, d, 2:] = demand.windows[movement[d], footprint[d], movement[c], footprint[c]]
    return Course(cars, exit_m, kind, ground, since, met[:rows])


@kernel
def until(window: Floats) -> float:
    """Until when a window of `Demand.blocked` may be in the way: its end, or always where it begins before the line."""
    return window[1] if window[2] >= 0.0 else NEVER


@kernel
def car_of(row: Floats) -> Car:
    """The car of a row of `Course.cars`."""
    return Car(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])


@kernel
def line_speed(car: Car, time: float, manner: Manner) -> float:
    """Speed over the line on the approach to a slot at `time`."""
    speed = car.line
    if time > car.first + 0.05:
        speed = approach(car.s, car.v, time, car.a, car.b, car.top, car.line_cap, manner)[2]
    return max(speed, SLOWEST_MPS)


@kernel
def kept_off(
    car: Car, time: float, speed: float, begin: float, end: float, enter: float, leave: float, margin: float
) -> float:
    """When a car over the line at `time` has to come instead to keep `margin` off a window (begin, end), s.

    The window is on the ground between its front's `enter` and its rear's `leave`, m past the line.
    """
    if enter >= 0.0 and time >= end + margin:
        return time
    mine_in = time + time_past_line(enter, speed, car.a, car.cross_top)
    if mine_in >= end + margin:
        return time
    begins = time > begin - margin and leave >= 0.0
    if begins or time + time_past_line(leave, speed, car.a, car.cross_top) > begin - margin:
        return time + end + margin - mine_in
    return time


@kernel
def settle(car: Car, start: float, met: Floats, placed: Floats, rules: Rules) -> tuple[float, float]:
    """The first (slot, line speed) of a car not before `start` that no reserved or placed window forbids.

    `met` (B, 4) as in `Course`, `placed` (P, 5) as `enter_windows` leaves them.
    """
    time, speed = max(start, car.first), SLOWEST_MPS
    for _ in range(SETTLE_ROUNDS):
        speed = line_speed(car, time, rules.manner)
        margin = max(rules.margin_s, rules.margin_m / speed + rules.extra_s)
        later = time
        for r in range(met.shape[0]):
            if time >= until(met[r]) + margin:
                break
            later = max(later, kept_off(car, time, speed, met[r, 0], met[r, 1], met[r, 2], met[r, 3], margin))
        later = max(later, off_placed(car, time, speed, placed, 0, placed.shape[0], rules))
        if later <= time + SAME_S:
            break
        time = later
    return time, speed


@kernel
def off_placed(car: Car, time: float, speed: float, placed: Floats, first: int, last: int, rules: Rules) -> float:
    """When a car over the line at `time` has to come instead for the placed windows `first` to `last`, s."""
    later, margin = time, max(rules.margin_s, rules.margin_m / speed + rules.extra_s)
    for k in range(first, last):
        leave, both = placed[k, 3] + car.length, max(margin, placed[k, 4])
        later = max(later, kept_off(car, time, speed, placed[k, 0], placed[k, 1], placed[k, 2], leave, both))
    return later


@kernel
def passed_by(time: float, placed: Floats, first: int, last: int, rules: Rules) -> int:
    """The first of the placed windows `first` to `last` that a car over the line at `time` or later may meet."""
    widest = max(rules.margin_s, rules.margin_m / SLOWEST_MPS + rules.extra_s)
    while first < last and placed[first, 2] >= 0.0 and time >= placed[first, 1] + max(widest, placed[first, 4]):
        first += 1
    return first


@kernel
def enter_windows(
    car: Car, slot: float, line: float, ground: Floats, rules: Rules, left: Ints, count: Ints, placed: Floats
) -> None:
    """Add the windows of a car over the line at `slot` with speed `line`, for each kind that meets it and is `left`.

    `ground` (C, 4) are the rows of its kind in `Course.ground`. A row of `placed` (C, n, 5), of which kind c has
    `count[c]`, is a window (in, out), s; where a front of the kind enters and a rear leaves it, m; and the margin that
    its holder asks for, s.
    """
    margin = rules.margin_m / line + rules.extra_s
    for c in range(count.shape[0]):
        if left[c] > 0 and ground[c, 3] > -NEVER:  # false for NaN
            k = count[c]
            placed[c, k, 0] = slot + time_past_line(ground[c, 0], line, car.a, car.cross_top)
            placed[c, k, 1] = slot + time_past_line(ground[c, 1] + car.length, line, car.a, car.cross_top)
            placed[c, k, 2], placed[c, k, 3], placed[c, k, 4] = ground[c, 2], ground[c, 3], margin
            count[c] = k + 1


@kernel
def behind(leader: Car, slot: float, line: float, b: float, headway_s: float) -> float:
    """Earliest slot directly behind `leader` in its lane: its own length and the standing gap, and the headway.

    The leader is over the line at `slot` with speed `line`; b is the follower's deceleration.
    """
    way = time_past_line(leader.length + motion.REAR_GAP_M, line, leader.a, leader.cross_top)
    worse_brake = max(0.0, 0.5 * line * (1.0 / b - 1.0 / leader.b))
    return float(slot + way + headway_s + worse_brake)


@kernel
def hold(car: Car, exit_m: float, line: float) -> float:
    """How long a car keeps the ground that others want, s."""
    if exit_m <= 0.0:
        return 0.0
    return float(time_past_line(exit_m + car.length, line, car.a, car.cross_top))


@kernel
def weighted_delays(
    demand: Demand, slots: Floats, priority: Floats, waited: Floats, patience_s: float, starvation_weight: float
) -> Floats:
    """(C,) predicted weighted delay sum Ps (T - s / v_max) of slots (C, n), s.

    Added to it, by its weight, is the sum of the squares of what each will have `waited` (n,) in s beyond patience.
    """
    delays = np.zeros(slots.shape[0])
    for c in range(slots.shape[0]):
        starving = 0.0
        for i in range(slots.shape[1]):
            delays[c] += priority[i] * (slots[c, i] - demand.s[i] / demand.top[i])
            starving += max(0.0, waited[i] + slots[c, i] - patience_s) ** 2
        delays[c] += starvation_weight * starving
    return delays
