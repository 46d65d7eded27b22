"""The schedule, which looks only at what has changed, against one that settles every lane head again each turn."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core.dispatch import schedule
from gameopt_im.core.kinematics import NEVER, approach, earliest_arrival, time_past_line
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import rules_of
from gameopt_im.core.slots import SETTLE_ROUNDS, Demand, Rules, course_of
from gameopt_im.core.snapshot import Floats, Ints
from gameopt_wire import motion

RULES = rules_of(Parameters())
MOVEMENTS, BODIES = 4, 2


@st.composite
def demands(draw: st.DrawFn) -> Demand:
    """Up to four lanes of up to four vehicles, some windows between their movements, some reservations."""
    counts = draw(st.lists(st.integers(1, 4), min_size=1, max_size=4))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = sum(counts)
    movement, footprint = random.integers(0, MOVEMENTS, n), random.integers(0, BODIES, n)
    enter = random.uniform(-2.0, 15.0, (MOVEMENTS, BODIES, MOVEMENTS, BODIES))
    apart = random.random((MOVEMENTS, MOVEMENTS)) < draw(st.floats(0.0, 1.0))
    enter[(apart | apart.T)[:, None, :, None] & np.ones_like(enter, dtype=np.bool_)] = np.nan
    queue = np.full((len(counts), max(counts)), -1, dtype=np.int64)
    s, start = np.empty(n), 0
    for lane, count in enumerate(counts):
        queue[lane, :count] = start + np.arange(count)
        s[start : start + count] = np.cumsum(random.uniform(7.0, 40.0, count))
        start += count
    reservations = draw(st.integers(0, 4))
    begin, ground = random.uniform(-1.0, 15.0, (n, reservations)), random.uniform(-2.0, 15.0, (n, reservations))
    blocked = np.stack([begin, begin + random.uniform(0.2, 4.0, begin.shape), ground, ground + 8.0], axis=2)
    blocked[random.random((n, reservations)) < 0.5] = np.nan
    top = random.uniform(10.0, 20.0, n)
    cap = np.where(random.random(n) < 0.3, 0.6 * top, top)
    return Demand(
        s=s, v=top * random.choice([0.0, 0.3, 1.0], n), length=random.uniform(4.0, 12.0, n),
        a=random.uniform(0.8, 2.5, n), b=random.uniform(3.5, 5.0, n), top=top, line_cap=cap, cross_top=cap,
        movement=movement, footprint=footprint, lane=np.repeat(np.arange(len(counts)), counts), queue=queue,
        arrival=random.permutation(n), floor=random.choice([-NEVER, 4.0], len(counts)),
        windows=np.stack([enter, enter + random.uniform(4.0, 20.0, enter.shape)], axis=-1), blocked=blocked,
    )  # fmt: skip


def settled(i: int, start: float, demand: Demand, placed: list[int], slot: Floats, line: Floats) -> tuple[float, float]:
    """The first slot of i not before `start` that agrees with every window there is, each worked out again."""
    a, top = demand.a[i], demand.cross_top[i]
    turn_b = min(motion.TURN_DECEL_MPS2, demand.b[i])
    first, speed = earliest_arrival(demand.s[i], demand.v[i], a, demand.top[i], demand.line_cap[i], turn_b)
    time = max(start, first)
    for _ in range(SETTLE_ROUNDS):
        if time > first + 0.05:
            speed = approach(
                demand.s[i], demand.v[i], time, a, demand.b[i], demand.top[i], demand.line_cap[i], RULES.manner
            )[2]
        speed = max(speed, 0.5)
        margin = max(RULES.margin_s, RULES.margin_m / speed + RULES.extra_s)
        later = time
        for begin, end, enter, leave, both in windows(i, demand, placed, slot, line):
            mine_in = time + time_past_line(enter, speed, a, top)
            mine_out = time + time_past_line(leave, speed, a, top)
            keep = max(margin, both)
            if mine_in < end + keep and mine_out > begin - keep:
                later = max(later, time + end + keep - mine_in)
        if later <= time + 1e-9:
            break
        time = later
    return time, speed


def windows(
    i: int, demand: Demand, placed: list[int], slot: Floats, line: Floats
) -> list[tuple[float, float, float, float, float]]:
    """(in, out, my entry, my leaving distance, margin asked for) of all that is reserved or placed."""
    made = [(*row, 0.0) for row in demand.blocked[i].tolist() if not np.isnan(row[1])]
    me = demand.movement[i], demand.footprint[i]
    for j in placed:
        it = demand.movement[j], demand.footprint[j]
        mine, its = demand.windows[*me, *it], demand.windows[*it, *me]
        if not np.isnan(mine[1]):
            begin, end = (
                slot[j] + time_past_line(x, line[j], demand.a[j], demand.cross_top[j])
                for x in (its[0], its[1] + demand.length[j])
            )
            made.append((begin, end, mine[0], mine[1] + demand.length[i], RULES.margin_m / line[j] + RULES.extra_s))
    return made


def plain(demand: Demand, rules: Rules, bids: Floats, order: Ints, dispatch: bool) -> tuple[list[int], Floats, Floats]:
    """The schedule by its definition: each turn every lane head is settled against everything."""
    n, lanes = len(demand.s), len(demand.queue)
    slot, line, taken = np.full(n, NEVER), np.full(n, 1.0), list[int]()
    place, fresh = [0] * lanes, [False] * lanes
    for turn in range(n):
        offers = []
        for k in range(lanes):
            i = int(demand.queue[k, place[k]]) if place[k] < demand.queue.shape[1] else -1
            if i < 0 or (not dispatch and order[turn] != i):
                continue
            start = slot[i] if fresh[k] else demand.floor[k]
            if not fresh[k] and place[k] > 0:
                j = demand.queue[k, place[k] - 1]
                way = time_past_line(demand.length[j] + motion.REAR_GAP_M, line[j], demand.a[j], demand.cross_top[j])
                brake = max(0.0, 0.5 * line[j] * (1.0 / demand.b[i] - 1.0 / demand.b[j]))
                start = max(start, slot[j] + way + rules.headway_s + brake)
            fresh[k] = True
            slot[i], line[i] = settled(i, start, demand, taken, slot, line)
            exits = [
                demand.windows[demand.movement[i], demand.footprint[i], m, demand.footprint[i], 1]
                for m in range(MOVEMENTS)
            ]
            exit_m = np.nanmax([0.0, *exits])
            hold = time_past_line(exit_m + demand.length[i], line[i], demand.a[i], demand.cross_top[i])
            score = bids[i] - slot[i] - rules.hold_weight * (hold if exit_m > 0.0 else 0.0)
            offers.append((-score, demand.arrival[i], k, i))
        _, _, k, i = min(offers)
        taken.append(i)
        place[k] += 1
        fresh[k] = False
    return taken, slot, line


@given(problem=demands(), seed=st.integers(0, 2**32), dispatch=st.booleans())
@settings(max_examples=150, deadline=None)
def test_looking_at_what_changed_is_looking_at_everything(problem: Demand, seed: int, dispatch: bool) -> None:
    n = len(problem.s)
    random = np.random.default_rng(seed)
    bids = random.uniform(0.0, 15.0, n)
    lanes = random.permutation(problem.lane)
    following = {lane: iter(row[row >= 0].tolist()) for lane, row in enumerate(problem.queue)}
    order = np.array([next(following[int(lane)]) for lane in lanes])
    taken, slot, line = schedule(problem, RULES, course_of(problem), bids, order, dispatch)
    expected_taken, expected_slot, expected_line = plain(problem, RULES, bids, order, dispatch)
    assert taken.tolist() == expected_taken
    assert slot.tobytes() == expected_slot.tobytes()
    assert line.tobytes() == expected_line.tobytes()
