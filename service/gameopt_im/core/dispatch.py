"""Slots for a crossing order, or for an auction's bids.

Because a slot contains the cost of switching movements, the dispatch auction (largest bid less slot goes next) forms
platoons by itself. What it does not contain is how long the vehicle itself will keep the ground, so that is taken
off, too.
"""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.slots import (
    SAME_S,
    B,
    Course,
    Demand,
    Rules,
    behind,
    car_of,
    course_of,
    enter_windows,
    hold,
    off_placed,
    passed_by,
    settle,
)
from gameopt_im.core.snapshot import Floats, Ints


@kernel
def schedule(
    demand: Demand, rules: Rules, course: Course, bids: Floats, order: Ints, dispatch: bool
) -> tuple[Ints, Floats, Floats]:
    """(order, slots, line speeds): of the dispatch auction on `bids` (s), or of the given lane-respecting order.

    `bids` already include the transfers of blocked followers. A lane's head that has a slot keeps it until a vehicle
    placed since takes ground it meant to use: its slot agreed with all that were placed before.
    """
    queue, arrival, kind, cars = demand.queue, demand.arrival, course.kind, course.cars
    n, lanes, kinds = kind.shape[0], queue.shape[0], course.ground.shape[0]
    slot, line, score = np.full(n, NEVER), np.full(n, 1.0), np.full(n, -NEVER)
    taken, floor = np.empty(n, np.int64), demand.floor.copy()
    head, ahead = queue[:, 0].copy(), np.zeros(lanes, np.int64)
    seen = np.full(lanes, -1)  # placed windows that the lane's head agrees with; -1: it has no slot yet
    past, past_kind = np.zeros(lanes, np.int64), np.full(lanes, -1)  # windows that are over for all of the lane
    count, placed, left = np.zeros(kinds, np.int64), np.empty((kinds, n, 5)), np.zeros(kinds, np.int64)
    for c in kind:
        left[c] += 1  # still to be placed
    for turn in range(n):
        best, chosen = -1, -1
        for k in range(lanes):
            i = head[k]
            if i < 0 or (not dispatch and order[turn] != i):
                continue
            c = kind[i]
            if seen[k] < count[c] or seen[k] < 0:
                car, start = car_of(cars[i]), floor[k]
                if seen[k] >= 0:
                    start = off_placed(car, slot[i], line[i], placed[c], seen[k], count[c], rules)
                if seen[k] < 0 or start > slot[i] + SAME_S:
                    if past_kind[k] != c:
                        past[k], past_kind[k] = 0, c
                    met = course.met[course.since[i] : course.since[i + 1]]
                    slot[i], line[i] = settle(car, start, met, placed[c, past[k] : count[c]], rules)
                    past[k] = passed_by(slot[i], placed[c], past[k], count[c], rules)
                    score[i] = bids[i] - slot[i] - rules.hold_weight * hold(car, course.exit_m[i], line[i])
                seen[k] = count[c]
            earlier = best >= 0 and score[i] == score[chosen] and arrival[i] < arrival[chosen]
            if best < 0 or score[i] > score[chosen] or earlier:
                best, chosen = k, i
        taken[turn], seen[best] = chosen, -1
        left[kind[chosen]] -= 1
        car = car_of(cars[chosen])
        enter_windows(car, slot[chosen], line[chosen], course.ground[kind[chosen]], rules, left, count, placed)
        ahead[best] += 1
        head[best] = queue[best, ahead[best]] if ahead[best] < queue.shape[1] else -1
        if head[best] >= 0:
            b = cars[head[best], B]
            floor[best] = max(floor[best], behind(car, slot[chosen], line[chosen], b, rules.headway_s))
    return taken, slot, line


@kernel
def schedules(demand: Demand, rules: Rules, bids: Floats, order: Ints) -> tuple[Ints, Floats, Floats]:
    """`schedule` of the given order, then of the dispatch auction on each row of `bids` (C, n): all (C + 1, n)."""
    course = course_of(demand)
    shape = bids.shape[0] + 1, bids.shape[1]
    orders, slots, lines = np.empty(shape, np.int64), np.empty(shape), np.empty(shape)
    for k in range(shape[0]):
        row = bids[max(k - 1, 0)]
        orders[k], slots[k], lines[k] = schedule(demand, rules, course, row, order, k > 0)
    return orders, slots, lines


@kernel
def slots_of(demand: Demand, rules: Rules, orders: Ints) -> tuple[Floats, Floats]:
    """(slots, line speeds), both (C, n), of the given lane-respecting orders (C, n)."""
    course, unused = course_of(demand), np.zeros(orders.shape[1])
    slots, lines = np.empty(orders.shape), np.empty(orders.shape)
    for k in range(orders.shape[0]):
        _, slots[k], lines[k] = schedule(demand, rules, course, unused, orders[k], False)
    return slots, lines
