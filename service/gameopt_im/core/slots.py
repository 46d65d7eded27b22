"""Slots: when each uncleared vehicle crosses its stop line, for a crossing order or for an auction's bids.

A vehicle's slot is the first time that respects its own earliest arrival, its leader's slot and a headway, and
every conflicting window already placed. Because a slot contains the cost of switching movements, the dispatch
auction (largest bid less slot goes next) forms platoons by itself. What it does not contain is how long the vehicle
itself will keep the ground, so that is taken off, too. Times in s from the snapshot.
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
KNOWN = 64
"""Line speeds remembered for a vehicle."""


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

    `first`, `line` (n,) are the earliest arrival and the line speed then, `exit_m` (n,) where the vehicle has left
    the last ground that others want, 0 where there is none. `kind` (n,) indexes `movement` and `footprint` (C,).
    `met` (B, 4) holds the rows of `Demand.blocked` where they meet, vehicle i's from `since[i]` to `since[i + 1]`.
    `known` (n, KNOWN, 2) remembers line speeds, (slot, speed): candidates ask for the same ones again and again.
    """

    first: Floats
    line: Floats
    exit_m: Floats
    kind: Ints
    movement: Ints
    footprint: Ints
    since: Ints
    met: Floats
    known: Floats


class Car(NamedTuple):
    """One vehicle of a demand and its course, as numbers: kernels take numbers sooner than many arrays."""

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


@kernel
def course_of(demand: Demand) -> Course:
    """The course of a demand."""
    n, bodies = demand.s.shape[0], demand.windows.shape[1]
    first, line, exit_m = np.empty(n), np.empty(n), np.zeros(n)
    kind, since = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    named = np.full(demand.windows.shape[0] * bodies, -1)
    movement, footprint = np.empty(n, np.int64), np.empty(n, np.int64)
    met = np.empty((demand.blocked.shape[0] * demand.blocked.shape[1], 4))
    kinds = rows = 0
    for i in range(n):
        turn_b = min(motion.TURN_DECEL_MPS2, demand.b[i])
        first[i], line[i] = earliest_arrival(
            demand.s[i], demand.v[i], demand.a[i], demand.top[i], demand.line_cap[i], turn_b
        )
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
                met[rows] = demand.blocked[i, r]
                rows += 1
        since[i + 1] = rows
    return Course(
        first,
        line,
        exit_m,
        kind,
        movement[:kinds],
        footprint[:kinds],
        since,
        met[:rows],
        np.full((n, KNOWN, 2), -NEVER),
    )


@kernel
def car_of(i: int, demand: Demand, course: Course) -> Car:
    """Vehicle i."""
    return Car(
        demand.s[i], demand.v[i], demand.length[i], demand.a[i], demand.b[i], demand.top[i], demand.line_cap[i],
        demand.cross_top[i], course.first[i], course.line[i],
    )  # fmt: skip


@kernel
def line_speed(car: Car, time: float, manner: Manner, known: Floats) -> float:
    """Speed over the line on the approach to a slot at `time`; `known` (KNOWN, 2) as in `Course`."""
    if time <= car.first + 0.05:
        return max(car.line, 0.5)
    place = int(abs(time) * 1e6) % KNOWN
    if known[place, 0] != time:
        speed = approach(car.s, car.v, time, car.a, car.b, car.top, car.line_cap, manner)[2]
        known[place, 0], known[place, 1] = time, max(speed, 0.5)
    return float(known[place, 1])


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
    if mine_in < end + margin and time + time_past_line(leave, speed, car.a, car.cross_top) > begin - margin:
        return time + end + margin - mine_in
    return time


@kernel
def settle(car: Car, start: float, met: Floats, placed: Floats, known: Floats, rules: Rules) -> tuple[float, float]:
    """The first (slot, line speed) of a car not before `start` that no reserved or placed window forbids.

    `met` (B, 4) as in `Course`, `placed` (P, 5) as `enter_windows` leaves them.
    """
    time, speed = max(start, car.first), 0.5
    for _ in range(SETTLE_ROUNDS):
        speed = line_speed(car, time, rules.manner, known)
        margin = max(rules.margin_s, rules.margin_m / speed + rules.extra_s)
        later = time
        for r in range(met.shape[0]):
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
def enter_windows(
    j: int, slot: float, line: float, demand: Demand, rules: Rules, course: Course, count: Ints, placed: Floats
) -> None:
    """Add the windows of vehicle j, over the line at `slot` with speed `line`, for each of the kinds that meets them.

    A row of `placed` (C, n, 5), of which kind c has `count[c]`, is a window (in, out), s; where a front of the kind
    enters and a rear leaves it, m; and the margin that its holder asks for, s.
    """
    movement, footprint, a, top = demand.movement[j], demand.footprint[j], demand.a[j], demand.cross_top[j]
    for c in range(count.shape[0]):
        theirs = demand.windows[course.movement[c], course.footprint[c], movement, footprint]
        if theirs[1] > -NEVER:  # false for NaN
            mine, k = demand.windows[movement, footprint, course.movement[c], course.footprint[c]], count[c]
            placed[c, k, 0] = slot + time_past_line(mine[0], line, a, top)
            placed[c, k, 1] = slot + time_past_line(mine[1] + demand.length[j], line, a, top)
            placed[c, k, 2], placed[c, k, 3] = theirs[0], theirs[1]
            placed[c, k, 4] = rules.margin_m / line + rules.extra_s
            count[c] += 1


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
def schedule(
    demand: Demand, rules: Rules, course: Course, bids: Floats, order: Ints, dispatch: bool
) -> tuple[Ints, Floats, Floats]:
    """(order, slots, line speeds): of the dispatch auction on `bids` (s), or of the given lane-respecting order.

    `bids` already include the transfers of blocked followers. A lane's head that has a slot keeps it until a vehicle
    placed since takes ground it meant to use: its slot agreed with all that were placed before.
    """
    n, lanes, kinds = demand.s.shape[0], demand.queue.shape[0], course.movement.shape[0]
    slot, line, score = np.full(n, NEVER), np.full(n, 1.0), np.full(n, -NEVER)
    taken = np.empty(n, np.int64)
    ahead = np.zeros(lanes, np.int64)
    seen = np.full(lanes, -1)  # placed windows that the lane's head agrees with; -1: it has no slot yet
    count, placed = np.zeros(kinds, np.int64), np.empty((kinds, n, 5))
    for turn in range(n):
        best, chosen = -1, -1
        for k in range(lanes):
            i = demand.queue[k, ahead[k]] if ahead[k] < demand.queue.shape[1] else -1
            if i < 0 or (not dispatch and order[turn] != i):
                continue
            c = course.kind[i]
            if seen[k] < count[c]:
                car = car_of(i, demand, course)
                if seen[k] < 0:
                    start = demand.floor[k]
                    if ahead[k] > 0:
                        j = demand.queue[k, ahead[k] - 1]
                        start = max(start, behind(car_of(j, demand, course), slot[j], line[j], car.b, rules.headway_s))
                else:
                    start = off_placed(car, slot[i], line[i], placed[c], seen[k], count[c], rules)
                if seen[k] < 0 or start > slot[i] + SAME_S:
                    met = course.met[course.since[i] : course.since[i + 1]]
                    slot[i], line[i] = settle(car, start, met, placed[c, : count[c]], course.known[i], rules)
                    score[i] = bids[i] - slot[i] - rules.hold_weight * hold(car, course.exit_m[i], line[i])
                seen[k] = count[c]
            earlier = best >= 0 and score[i] == score[chosen] and demand.arrival[i] < demand.arrival[chosen]
            if best < 0 or score[i] > score[chosen] or earlier:
                best, chosen = k, i
        taken[turn] = chosen
        enter_windows(chosen, slot[chosen], line[chosen], demand, rules, course, count, placed)
        ahead[best] += 1
        seen[best] = -1
    return taken, slot, line


def weighted_delay(demand: Demand, slot: Floats, priority: Floats) -> float:
    """Predicted weighted delay sum Ps (T - s / v_max), s."""
    return float(np.sum(priority * (slot - demand.s / demand.top)))
