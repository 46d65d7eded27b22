"""The sponsored-search auction: allocation, payment, utility, overflow transfers, candidate sequences.

Turns are the items, and turn k is worth alpha_k to whoever gets it. Ties go by index, which is the order of
arrival, then of id (`Snapshot`). Bids, values and payments share the master bid's scale, without unit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core.conflicts import OUTSIDE
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Floats, Ints


def allocate(bids: Floats) -> Ints:
    """(n,) the order of crossing: the i-th highest bid gets the i-th most valuable turn, ties by index."""
    return np.argsort(-bids, kind="stable")


def slot_values(n: int, ratio: float) -> Floats:
    """(n,) alpha_k = ratio^(k-1), strictly decreasing for 0 < ratio < 1; alpha_{n+1} is taken as 0."""
    return np.asarray(ratio ** np.arange(n, dtype=np.float64))


def prices(bids: Floats, alpha: Floats) -> Floats:
    """(n,) payment per turn, the second term of `eq: utility_template`.

    `bids` (n,) in the order of the turns. Turn i pays sum_{j=i}^{n} b_{j+1} (alpha_j - alpha_{j+1}) with
    b_{n+1} = alpha_{n+1} = 0: what its holder costs those behind, each of whom would move up by one.
    """
    steps = np.append(bids[1:], 0.0)[: len(bids)] * -np.diff(alpha, append=0.0)
    return np.cumsum(steps[::-1])[::-1]


def utility(value: float, turn: int, bids: Floats, alpha: Floats) -> float:
    """`eq: utility_template`: what a turn (from 0) is worth to a vehicle of this value, less its payment."""
    return float(value * alpha[turn] - prices(bids, alpha)[turn])


def transfer_bound(value: float, early: int, late: int, bids: Floats, alpha: Floats) -> float:
    """The most a vehicle may give away of its value and still gain (`thm: overflow`); a smaller gift pays.

    The giver (value zeta) is held at turn `late` by a lower bid ahead of it in its lane; its gift brings it
    to turn `early`. `bids` (n,) are those of the turns as they are after the gift, the giver's at `early` and
    those of the vehicles it passed at early+1 .. late. Turns count from 0. With e = early, the bound is
    zeta (1 - alpha_late / alpha_e) - sum_{s=e}^{late-1} b_{s+1} (alpha_s - alpha_{s+1}) / alpha_e:
    what it gains by the earlier turn less what that costs more, per unit of the turn's value.
    """
    passed = bids[early + 1 : late + 1] @ (alpha[early:late] - alpha[early + 1 : late + 1])
    return float(value * (1.0 - alpha[late] / alpha[early]) - passed / alpha[early])


def transfer(giver: float, receiver: float, amount: float) -> tuple[float, float]:
    """The paper's (a, b) with a giving c to b: (a - c, b + c)."""
    return giver - amount, receiver + amount


class Queues(NamedTuple):
    """Who stands behind whom in the lanes.

    `slots` (L, D): the vehicles of each lane, front first, n where a lane has no more. `lane` (n,) is a
    vehicle's row there and `place` (n,) its column, the number of vehicles ahead of it. `arrival` (n,) breaks
    ties between bids: the lower goes first.
    """

    slots: Ints
    lane: Ints
    place: Ints
    arrival: Ints


@kernel
def queues(lane: Ints, s: Floats, arrival: Ints) -> Queues:
    """The queues of n vehicles from their lanes, distances to the stop line (m) and places in order of arrival."""
    n = lane.shape[0]
    front = np.argsort(s, kind="mergesort")
    front = front[np.argsort(lane[front], kind="mergesort")]
    row, place = np.empty(n, np.int64), np.empty(n, np.int64)
    lanes = longest = 0
    for k in range(n):
        i = front[k]
        follows = k > 0 and lane[front[k - 1]] == lane[i]
        place[i] = place[front[k - 1]] + 1 if follows else 0
        lanes += 0 if follows else 1
        row[i] = lanes - 1
        longest = max(longest, place[i] + 1)
    slots = np.full((lanes, longest), n, np.int64)
    for i in range(n):
        slots[row[i], place[i]] = i
    return Queues(slots, row, place, arrival)


@kernel
def _ranks(bids: Floats, arrival: Ints) -> Ints:
    """(K, n) place of each vehicle by bid alone, 0 for the highest; ties by arrival, so no two are equal."""
    ranks, by_arrival = np.empty(bids.shape, np.int64), np.argsort(arrival, kind="mergesort")
    for k in range(bids.shape[0]):
        order = by_arrival[np.argsort(-bids[k][by_arrival], kind="mergesort")]
        for turn in range(order.shape[0]):
            ranks[k, order[turn]] = turn
    return ranks


@kernel
def _held(ranks: Ints, lines: Queues) -> Ints:
    """(K, n) the rank a vehicle really has: the worst from the head of its lane down to itself."""
    held = ranks.copy()
    for k in range(ranks.shape[0]):
        for row in range(lines.slots.shape[0]):
            worst = -1
            for i in lines.slots[row]:
                if i == ranks.shape[1]:
                    break
                worst = max(worst, ranks[k, i])
                held[k, i] = worst
    return held


@kernel
def _merged(held: Ints, lines: Queues) -> Ints:
    """(K, n) orders: by the rank each is held at; vehicles held by the same one keep their lane's order.

    Ranks are small numbers, so they are counted instead of sorted.
    """
    n, orders = held.shape[1], np.empty_like(held)
    for k in range(held.shape[0]):
        turn = np.zeros(n + 1, np.int64)  # of the next vehicle that is held at each rank
        for rank in held[k]:
            turn[rank + 1] += 1
        turn = np.cumsum(turn)
        for row in range(lines.slots.shape[0]):
            for i in lines.slots[row]:
                if i == n:
                    break
                orders[k, turn[held[k, i]]] = i
                turn[held[k, i]] += 1
    return orders


def lane_orders(bids: Floats, lines: Queues) -> Ints:
    """(K, n) orders that respect the lanes: repeatedly take, among lane heads, the largest bid.

    Whoever is taken frees the next of its lane, so a vehicle goes when the lowest bid from the head of its
    lane down to itself goes: sorting by that running worst rank is the same and needs no loop.
    """
    return np.asarray(_merged(_held(_ranks(bids, lines.arrival), lines), lines))


def with_transfers(bids: Floats, lines: Queues, group: Ints, ratio: float, share: float) -> Floats:
    """(K, n) bids after overflow transfers (`thm: overflow`); the sum per weight vector stays what it was.

    A vehicle held up by lower bids ahead of it in its lane gives away `share` of its bound, in equal parts to
    those of its conflict group that outbid it by less. Its gain is counted as if all of them moved with it:
    it would pass the vehicles of its group in other lanes whose held rank lies between its own rank and the
    rank it is held at. `group` (n,) holds conflict groups; vehicles `OUTSIDE` give and get nothing.
    """
    if share == 0.0:
        return bids
    return np.asarray(_transferred(bids, lines, group, ratio, share, slot_values(bids.shape[1] + 1, ratio)))


@kernel
def _transferred(bids: Floats, lines: Queues, group: Ints, ratio: float, share: float, alpha: Floats) -> Floats:
    ranks = _ranks(bids, lines.arrival)
    held = _held(ranks, lines)
    row, giver = np.nonzero((ranks < held) & (group != OUTSIDE))
    if giver.shape[0] == 0:
        return bids
    orders = _merged(held, lines)
    cost, passed = _passed(bids * (1.0 - ratio), orders, lines.lane, group, ranks, held, row, giver, alpha)
    amount = np.empty(giver.shape[0])
    for r in range(giver.shape[0]):
        # With alpha_k = ratio^(k-1) only the differences of turns count: passing m vehicles of bids b_1 .. b_m makes
        # `transfer_bound` zeta (1 - ratio^m) - sum_t b_t (1 - ratio) ratio^(t-1).
        bound = bids[row[r], giver[r]] * (1.0 - alpha[passed[r]]) - cost[r]
        amount[r] = share * max(bound, 0.0)
    return bids + _moved(amount, lines.slots, lines.lane, lines.place, group, ranks, row, giver)


@kernel
def _passed(
    weighed: Floats,
    orders: Ints,
    lane: Ints,
    group: Ints,
    ranks: Ints,
    held: Ints,
    row: Ints,
    giver: Ints,
    alpha: Floats,
) -> tuple[Floats, Ints]:
    """(cost (R,), number (R,)) of the vehicles that each of R givers would pass, by their turns.

    Giver `giver[r]` is one under weight vector `row[r]`; `weighed` (K, n) are the bids times 1 - ratio.
    """
    cost, passed = np.zeros(len(giver)), np.zeros(len(giver), np.int64)
    for r in range(len(giver)):
        k, i = row[r], giver[r]
        for j in orders[k]:
            between = ranks[k, i] < held[k, j] < held[k, i]
            if between and group[j] == group[i] and lane[j] != lane[i]:
                cost[r] += weighed[k, j] * alpha[passed[r]]
                passed[r] += 1
    return cost, passed


@kernel
def _moved(
    amount: Floats, slots: Ints, lane: Ints, place: Ints, group: Ints, ranks: Ints, row: Ints, giver: Ints
) -> Floats:
    """(K, n) what the transfers of `amount` (R,) change: taken less given, in equal parts to who is outbid ahead."""
    taken, given = np.zeros(ranks.shape), np.zeros(ranks.shape)
    for r in range(len(giver)):
        k, i = row[r], giver[r]
        ahead = slots[lane[i], : place[i]]
        receivers = 0
        for j in ahead:
            receivers += ranks[k, j] > ranks[k, i] and group[j] == group[i]
        if receivers:
            given[k, i] = amount[r]
            for j in ahead:
                if ranks[k, j] > ranks[k, i] and group[j] == group[i]:
                    taken[k, j] += amount[r] / receivers
    return taken - given


def distinct(orders: Ints, group: Ints) -> Ints:
    """Indices of the first of each set of (K, n) orders that run every conflict group alike."""
    by_group = np.take_along_axis(orders, np.argsort(group[orders], axis=1, kind="stable"), axis=1)
    canonical = by_group[:, np.count_nonzero(group == OUTSIDE) :]
    seen = {canonical[k].tobytes(): k for k in reversed(range(len(orders)))}
    return np.array(sorted(seen.values()), dtype=np.int64)


def sequences(bids: Floats, lines: Queues, group: Ints, ratio: float, share: float) -> list[Ints]:
    """Candidate sequences, at most one per weight vector, distinct inside some conflict group.

    Per vector and conflict group the lane-respecting order of the bids with transfers, merged into one order.
    Taking the largest head over all lanes takes the largest of each group in turn, so one pass serves all.
    """
    orders = lane_orders(with_transfers(bids, lines, group, ratio, share), lines)
    return [orders[k] for k in distinct(orders, group)]


def prices_of_order(order: Ints, bids: Floats, group: Ints, ratio: float) -> Floats:
    """(n,) what each vehicle pays for its turn in its own conflict group when `order` is run; 0 outside."""
    return np.asarray(_charged(order, bids, group, slot_values(len(bids) + 1, ratio)))


@kernel
def _charged(order: Ints, bids: Floats, group: Ints, alpha: Floats) -> Floats:
    """`prices` within every group at once, from the last turn to the first."""
    charged, groups = np.zeros(bids.shape[0]), group.max() + 1
    turns, price, behind = np.zeros(groups, np.int64), np.zeros(groups), np.zeros(groups)
    for label in group[group != OUTSIDE]:
        turns[label] += 1
    for i in order[::-1]:
        g = group[i]
        if g == OUTSIDE:
            continue
        turns[g] -= 1
        price[g] += behind[g] * (alpha[turns[g]] - alpha[turns[g] + 1])  # nobody is behind the last
        charged[i], behind[g] = price[g], bids[i]
    return charged
