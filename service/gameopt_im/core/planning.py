"""From a snapshot to candidate sequences with slots: the dispatch auction, K times, and the incumbent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gameopt_im.core import auction, bids
from gameopt_im.core.conflicts import Ground, groups
from gameopt_im.core.dispatch import schedules, slots_of
from gameopt_im.core.horizon import HorizonRules, HorizonTask, platoons
from gameopt_im.core.interlock import UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, kernel, manner_of
from gameopt_im.core.lanes import floors_behind, lane_by_lane, room_behind_leaders
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.reservations import Book, Stack, blocked_windows
from gameopt_im.core.slots import Demand, Rules, weighted_delays
from gameopt_im.core.snapshot import Floats, Ints, Snapshot

INCUMBENT = -1
"""In place of a weight vector's number."""


@dataclass(frozen=True, slots=True)
class Bidders:
    """The vehicles still to be planned, lane by lane, front to back: the rows of every planning array.

    `index` (n,) are their places in the snapshot, `counts` the vehicles of each lane, `bids` (K, n) their master
    bids with transfers, `group` (n,) their conflict groups.
    """

    index: Ints
    counts: tuple[int, ...]
    bids: Floats
    group: Ints

    def __len__(self) -> int:
        return len(self.index)

    def tried(self, candidates: int) -> Bidders:
        """With the bids of the first weight vectors only, or of none."""
        return replace(self, bids=self.bids[:candidates])


@dataclass(frozen=True, slots=True)
class Candidate:
    """A crossing order of the bidders with a slot and a line speed each.

    `delay` is sum Ps (T - s / v_max), s, and what it costs that some will have been in the zone for too long.
    """

    weights: int
    order: Ints
    slots: Floats
    lines: Floats
    delay: float


def bidders(
    snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, parameters: Parameters, candidates: int
) -> Bidders:
    """Who takes part in this control cycle's auction, and with which bids."""
    unplanned = (limits.phase == UNCLEARED) & (book.rows_of(snapshot.ids) < 0) & ~snapshot.silent
    index, counts = lane_by_lane(unplanned, snapshot.lane, snapshot.s)
    settings = parameters.auction
    group = groups(snapshot.movement[index], ground.conflict)
    features = bids.features(
        snapshot.s[index], snapshot.v[index], snapshot.waited[index], snapshot.assertiveness[index], settings
    )
    master = bids.with_waiting(
        bids.master_bids(features, settings.weights[:candidates]),
        snapshot.waited[index],
        settings.waiting_multiplier,
    )
    if len(index):
        lines = auction.queues(snapshot.lane[index], snapshot.s[index], index)
        master = auction.with_transfers(master, lines, group, settings.slot_value_ratio, settings.transfer_share)
    return Bidders(index, tuple(counts.tolist()), master, group)


def demand(
    snapshot: Snapshot,
    ground: Ground,
    book: Book,
    stack: Stack,
    limits: Limits,
    who: Bidders,
    parameters: Parameters,
) -> Demand:
    """The planning problem of the bidders around the reservations in force."""
    i = who.index
    movement, footprint = snapshot.movement[i], snapshot.footprint[i]
    turn = np.minimum(ground.turn_mps[movement], NEVER)
    blocked = blocked_windows(
        movement, footprint, snapshot.length[i],
        stack.x, stack.late_x, stack.first, stack.movement, stack.footprint, stack.length, ground.windows,
    )  # fmt: skip
    return Demand(
        s=snapshot.s[i],
        v=snapshot.v[i],
        length=snapshot.length[i],
        a=snapshot.a_max[i] * parameters.planner.accel_share,
        b=snapshot.b_max[i],
        top=snapshot.v_max[i],
        line_cap=np.minimum(turn, snapshot.v_max[i]),
        cross_top=np.minimum(turn, np.minimum(snapshot.v_max[i], ground.exit_mps[movement])),
        movement=movement,
        footprint=footprint,
        lane=snapshot.lane[i],
        queue=_queue(np.array(who.counts, dtype=np.int64)),
        arrival=i,
        floor=_floors(snapshot, book, limits, who, parameters),
        windows=ground.windows,
        blocked=blocked,
    )


@kernel
def _queue(counts: Ints) -> Ints:
    """(lanes, longest): the bidders' rows lane by lane, padded with -1."""
    queue = np.full((counts.shape[0], counts.max() if counts.shape[0] else 0), -1, np.int64)
    row = 0
    for lane in range(counts.shape[0]):
        for place in range(counts[lane]):
            queue[lane, place] = row
            row += 1
    return queue


def _floors(snapshot: Snapshot, book: Book, limits: Limits, who: Bidders, parameters: Parameters) -> Floats:
    """(lanes,) earliest slot of each lane's first bidder, behind the cleared vehicle ahead of it, s."""
    return floors_behind(
        who.index[first_rows(who)], limits.leader, book.rows_of(snapshot.ids), book.rows, snapshot.cycle,
        snapshot.b_max, parameters.planner.headway_s,
    )  # fmt: skip


def first_rows(who: Bidders) -> Ints:
    """(lanes,) the row of the first bidder of each lane."""
    return np.asarray(np.cumsum((0, *who.counts))[:-1])


def rules_of(parameters: Parameters) -> Rules:
    """The planner's margins; never tighter than what granting will ask for, or refusals cost capacity."""
    interlock, planner = parameters.interlock, parameters.planner
    return Rules(
        margin_s=planner.margin_s,
        margin_m=interlock.margin_m,
        extra_s=planner.margin_s - interlock.margin_s,
        headway_s=planner.headway_s,
        manner=manner_of(planner),
        hold_weight=planner.hold_weight,
    )


def candidates(
    problem: Demand,
    who: Bidders,
    priority: Floats,
    waited: Floats,
    incumbent: Sequence[int],
    parameters: Parameters,
) -> list[Candidate]:
    """The incumbent first, if it competes, then the distinct sequences of `auction.order`, one per weight vector.

    Beyond the planner's patience a wait raises the bid, in some sequences more than in others, and weighs in the
    choice between them by its square: the least total delay could starve a vehicle, while bids that only count waits
    end every platoon and cost capacity.
    `priority` (n,) are the Ps, `waited` (n,) in s; `incumbent` the bidders' rows in last cycle's order, with newcomers.
    """
    if not len(who):
        return []
    planner = parameters.planner
    seconds = _in_seconds(who.bids, parameters.auction.bid_seconds, waited, planner.patience_s, planner.impatience)
    given = by_lane(np.array(incumbent, dtype=np.int64), np.array(who.counts, dtype=np.int64))
    orders, slots, lines = _schedules(problem, seconds, given, parameters)
    delays = weighted_delays(problem, slots, priority, waited, planner.patience_s, planner.starvation_weight).tolist()
    first = {order.tobytes(): k for k, order in reversed(list(enumerate(orders))) if k or planner.incumbent}
    return [Candidate(k - 1, orders[k], slots[k], lines[k], delays[k]) for k in sorted(first.values())]


@kernel
def _in_seconds(
    bids: Floats, worth_s: float, waited: Floats, patience_s: float, impatience: tuple[float, ...]
) -> Floats:
    """(K, n) bids times what they are worth, s, raised by impatience for every second waited beyond patience."""
    seconds = np.empty_like(bids)
    for k in range(bids.shape[0]):
        for i in range(bids.shape[1]):
            overdue = max(0.0, waited[i] - patience_s)
            seconds[k, i] = worth_s * bids[k, i] + impatience[k % len(impatience)] * overdue
    return seconds


def _schedules(problem: Demand, seconds: Floats, given: Ints, parameters: Parameters) -> tuple[Ints, Floats, Floats]:
    """(orders, slots, line speeds): of the given order first, then by `auction.order` on bids (K, n) in seconds."""
    rule, rules = parameters.auction.order, rules_of(parameters)
    if not len(seconds):
        return given[None], *slots_of(problem, rules, given[None])
    if rule == "dispatch":
        return schedules(problem, rules, seconds, given)
    lines = auction.queues(problem.lane, problem.s, problem.arrival)
    bids = seconds if rule == "sorted" else -problem.arrival[None].astype(np.float64)
    orders = np.concatenate((given[None], auction.lane_orders(bids, lines)))
    return orders, *slots_of(problem, rules, orders)


@kernel
def by_lane(order: Ints, counts: Ints) -> Ints:
    """The order with every lane's turns given to its vehicles front to back: nobody overtakes in a lane."""
    lane, following = np.empty(len(order), np.int64), np.cumsum(counts) - counts
    for k in range(len(counts)):
        lane[following[k] : following[k] + counts[k]] = k
    out = np.empty_like(order)
    for turn, i in enumerate(order):
        out[turn] = following[lane[i]]
        following[lane[i]] += 1
    return out


class Stake(NamedTuple):
    """What a candidate goes into the choice of q* with: its delay, the weight of J beside it, an incumbent's bonus."""

    delay: float
    weight: float
    bonus: float

    def cost(self, objective: float) -> float:
        """Predicted weighted delay plus a weight times J, less the bonus: it grows with J."""
        cost = self.delay + self.weight * objective
        return cost - self.bonus * abs(cost)


def stake_of(option: Candidate, parameters: Parameters, solved: bool = True) -> Stake:
    """The stake of a candidate; the incumbent has a bonus. Where J alone counts, only it is at stake.

    In a control cycle that has no time for programs (not `solved`) there is no J, and the delay decides.
    """
    bonus = parameters.planner.incumbent_bonus if option.weights == INCUMBENT else 0.0
    if solved and parameters.planner.selection == "objective":
        return Stake(0.0, 1.0, bonus)
    return Stake(option.delay, parameters.program.objective_weight, bonus)


def select(
    options: Sequence[Candidate], objectives: Sequence[float | None], parameters: Parameters, solved: bool = True
) -> int | None:
    """q*: the candidate of least cost, the first of them.

    A candidate without a solution (None) is out; None where all are. `solved` is as for `stake_of`.
    """
    best: int | None = None
    least = np.inf
    for k, (option, objective) in enumerate(zip(options, objectives, strict=True)):
        if objective is None:
            continue
        cost = stake_of(option, parameters, solved).cost(objective)
        if cost < least:
            best, least = k, cost
    return best


def horizon_rules(parameters: Parameters) -> HorizonRules:
    """The horizon program's constants from the configuration."""
    return HorizonRules(
        blocks=parameters.program.blocks_s,
        trade_off=parameters.program.lambda_,
        rear_gap=parameters.program.rear_gap_m,
        manner=manner_of(parameters.planner),
    )


def horizon_task(
    snapshot: Snapshot, book: Book, limits: Limits, problem: Demand, who: Bidders, parameters: Parameters
) -> HorizonTask:
    """What the horizon programs of all candidates share."""
    ends = np.cumsum(parameters.program.blocks_s)
    room = np.full((len(who), len(ends)), NEVER)
    first = first_rows(who)
    room[first] = room_behind_leaders(
        who.index[first], limits.leader, book.rows_of(snapshot.ids), book.rows, snapshot.cycle, snapshot.s,
        snapshot.v, snapshot.length, parameters.program.rear_gap_m, ends,
    )  # fmt: skip
    counts, trails = platoons(who.counts)
    return HorizonTask(
        counts=counts,
        s=problem.s,
        v=problem.v,
        length=problem.length,
        a=problem.a,
        b=problem.b,
        top=problem.top,
        line_cap=problem.line_cap,
        ps=snapshot.speed_priority[who.index],
        pv=snapshot.variation_priority[who.index],
        room=room,
        trails=trails,
    )
