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


@kernel
def settle(
    i: int, start: float, demand: Demand, rules: Rules, placed: Ints, count: int, slot: Floats, line: Floats
) -> tuple[float, float]:
    """The first (slot, line speed) of vehicle i not before `start` that no placed or reserved window forbids."""
    movement, footprint, length = demand.movement[i], demand.footprint[i], demand.length[i]
    a, top = demand.a[i], demand.cross_top[i]
    turn_b = min(motion.TURN_DECEL_MPS2, demand.b[i])
    first, speed = earliest_arrival(demand.s[i], demand.v[i], a, demand.top[i], demand.line_cap[i], turn_b)
    time = max(start, first)
    for _ in range(SETTLE_ROUNDS):
        if time > first + 0.05:
            speed = approach(
                demand.s[i],
                demand.v[i],
                time,
                a,
                demand.b[i],
                demand.top[i],
                demand.line_cap[i],
                rules.manner,
            )[2]
        speed = max(speed, 0.5)
        margin = max(rules.margin_s, rules.margin_m / speed + rules.extra_s)
        later = time
        for r in range(demand.blocked.shape[1]):
            if demand.blocked[i, r, 1] > -NEVER:  # false for NaN
                begin = time + time_past_line(demand.blocked[i, r, 2], speed, a, top)
                end = time + time_past_line(demand.blocked[i, r, 3], speed, a, top)
                if begin < demand.blocked[i, r, 1] + margin and end > demand.blocked[i, r, 0] - margin:
                    later = max(later, time + demand.blocked[i, r, 1] + margin - begin)
        for k in range(count):
            j = placed[k]
            mine = demand.windows[movement, footprint, demand.movement[j], demand.footprint[j]]
            if mine[1] > -NEVER:
                its = demand.windows[demand.movement[j], demand.footprint[j], movement, footprint]
                begin = time + time_past_line(mine[0], speed, a, top)
                end = time + time_past_line(mine[1] + length, speed, a, top)
                its_in = slot[j] + time_past_line(its[0], line[j], demand.a[j], demand.cross_top[j])
                its_out = slot[j] + time_past_line(its[1] + demand.length[j], line[j], demand.a[j], demand.cross_top[j])
                both = max(margin, rules.margin_m / line[j] + rules.extra_s)
                if begin < its_out + both and end > its_in - both:
                    later = max(later, time + its_out + both - begin)
        if later <= time + 1e-9:
            break
        time = later
    return time, speed


@kernel
def behind(i: int, j: int, demand: Demand, rules: Rules, slot: Floats, line: Floats) -> float:
    """Earliest slot of i directly behind j in its lane: j's own length and the standing gap, and the headway."""
    way = time_past_line(demand.length[j] + motion.REAR_GAP_M, line[j], demand.a[j], demand.cross_top[j])
    worse_brake = max(0.0, 0.5 * line[j] * (1.0 / demand.b[i] - 1.0 / demand.b[j]))
    return float(slot[j] + way + rules.headway_s + worse_brake)


@kernel
def hold(i: int, demand: Demand, line: float) -> float:
    """How long vehicle i keeps the ground that others want, s."""
    exit_m = 0.0
    for m in range(demand.windows.shape[2]):
        window = demand.windows[demand.movement[i], demand.footprint[i], m, demand.footprint[i]]
        if window[1] > -NEVER:  # false for NaN
            exit_m = max(exit_m, window[1])
    if exit_m <= 0.0:
        return 0.0
    return float(time_past_line(exit_m + demand.length[i], line, demand.a[i], demand.cross_top[i]))


@kernel
def schedule(demand: Demand, rules: Rules, bids: Floats, order: Ints, dispatch: bool) -> tuple[Ints, Floats, Floats]:
    """(order, slots, line speeds): of the dispatch auction on `bids` (s), or of the given lane-respecting order.

    `bids` already include the transfers of blocked followers.
    """
    n = demand.s.shape[0]
    lanes = demand.queue.shape[0]
    slot, line = np.full(n, NEVER), np.full(n, 1.0)
    taken = np.empty(n, np.int64)
    place = np.zeros(lanes, np.int64)
    fresh = np.zeros(lanes, np.bool_)
    for count in range(n):
        best, chosen, best_score = -1, -1, -NEVER
        for k in range(lanes):
            i = demand.queue[k, place[k]] if place[k] < demand.queue.shape[1] else -1
            if i < 0 or (not dispatch and order[count] != i):
                continue
            if fresh[k]:
                start = slot[i]
            else:
                start = demand.floor[k]
                if place[k] > 0:
                    start = max(start, behind(i, demand.queue[k, place[k] - 1], demand, rules, slot, line))
                fresh[k] = True
            slot[i], line[i] = settle(i, start, demand, rules, taken, count, slot, line)
            score = bids[i] - slot[i] - rules.hold_weight * hold(i, demand, line[i])
            earlier = best >= 0 and score == best_score and demand.arrival[i] < demand.arrival[chosen]
            if score > best_score or earlier:
                best, best_score, chosen = k, score, i
        taken[count] = chosen
        place[best] += 1
        fresh[best] = False
    return taken, slot, line


def weighted_delay(demand: Demand, slot: Floats, priority: Floats) -> float:
    """Predicted weighted delay sum Ps (T - s / v_max), s."""
    return float(np.sum(priority * (slot - demand.s / demand.top)))
