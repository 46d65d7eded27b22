"""The auction's theorems against brute force: all orders of n vehicles that respect their lanes.

The static auction is one vehicle a lane in one conflict group. With more, the n! / prod(n_i!) orders that
keep every lane's own order are the oracle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gameopt_im.core import auction
from gameopt_im.core.auction import Queues
from gameopt_im.core.conflicts import OUTSIDE
from gameopt_im.core.snapshot import Floats, Ints

Order = tuple[int, ...]
values = st.integers(0, 40).map(lambda tenths: tenths / 10.0)
"""Bids from a coarse scale, so that ties are common."""
ratios = st.floats(0.05, 0.95)
lanes = st.lists(st.integers(0, 3), min_size=1, max_size=6)


def static(bids: list[float]) -> list[Order]:
    return list(itertools.permutations(range(len(bids))))


def lane_respecting(lines: Queues) -> Iterator[Order]:
    """Every order in which nobody overtakes in its lane."""
    n = len(lines.lane)
    for order in itertools.permutations(range(n)):
        places: dict[int, int] = {}
        for i in order:
            lane = int(lines.lane[i])
            if places.get(lane, 0) != lines.place[i]:
                break
            places[lane] = places.get(lane, 0) + 1
        else:
            yield order


def welfare(order: Order | Ints, bids: Floats, alpha: Floats) -> float:
    return float(bids[np.asarray(order, dtype=np.int64)] @ alpha)


def utility_of(i: int, value: float, order: list[int], bids: Floats, alpha: Floats) -> float:
    return auction.utility(value, order.index(i), bids[order], alpha)


@st.composite
def queued(draw: st.DrawFn) -> tuple[Floats, Queues]:
    """Bids of vehicles standing in up to four lanes, in no order of arrival."""
    lane = np.array(draw(lanes), dtype=np.int64)
    n = len(lane)
    s = np.array(draw(st.permutations(range(n))), dtype=np.float64)
    return np.array(draw(st.lists(values, min_size=n, max_size=n))), auction.queues(lane, s, np.arange(n))


@given(st.lists(values, min_size=1, max_size=6), ratios)
def test_the_allocation_maximises_welfare(bids: list[float], ratio: float) -> None:
    made, alpha = np.array(bids), auction.slot_values(len(bids), ratio)
    best = max(welfare(order, made, alpha) for order in static(bids))
    assert welfare(auction.allocate(made), made, alpha) == pytest.approx(best)


@given(st.lists(values, min_size=1, max_size=6), st.data(), ratios)
def test_bidding_the_truth_is_never_beaten_by_a_lone_deviation(
    bids: list[float], data: st.DataObject, ratio: float
) -> None:
    """`thm: incentive_compatibility`: whatever the others bid, the truth does best, and never at a loss."""
    others, alpha = np.array(bids), auction.slot_values(len(bids), ratio)
    i = data.draw(st.integers(0, len(bids) - 1))
    value = float(others[i])
    honest = utility_of(i, value, auction.allocate(others).tolist(), others, alpha)
    assert honest >= -1e-9
    for lie in {*bids, *(bid + 0.05 for bid in bids), *(bid - 0.05 for bid in bids), 0.0, 99.0}:
        told = others.copy()
        told[i] = lie
        assert utility_of(i, value, auction.allocate(told).tolist(), told, alpha) <= honest + 1e-9


@given(st.lists(values, min_size=1, max_size=6), ratios)
def test_a_payment_is_what_the_others_lose_by_its_payers_presence(bids: list[float], ratio: float) -> None:
    made, alpha = np.array(bids), auction.slot_values(len(bids), ratio)
    order = auction.allocate(made)
    charged = auction.prices_of_order(order, made, np.zeros(len(bids), dtype=np.int64), ratio)
    for i in range(len(bids)):
        rest = np.delete(made, i)
        without = max(welfare(other, rest, alpha[:-1]) for other in static(rest.tolist()))
        beside = welfare(order, made, alpha) - made[i] * alpha[order.tolist().index(i)]
        assert charged[i] == pytest.approx(without - beside, abs=1e-9)


@given(st.data(), ratios)
def test_a_transfer_pays_below_its_bound_and_not_above(data: st.DataObject, ratio: float) -> None:
    """`thm: overflow` by the two auctions themselves: the giver held up, and brought forward by its gift."""
    n = data.draw(st.integers(3, 6))
    bids = np.array(data.draw(st.lists(values, min_size=n, max_size=n)))
    early, late = sorted(data.draw(st.tuples(st.integers(1, n - 1), st.integers(1, n - 1))))
    blocker, giver = 0, 1
    rest = list(range(2, n))
    after = [*rest[: early - 1], blocker, giver, *rest[early - 1 :]]
    before = [i for i in after if i not in (blocker, giver)]
    before[late - 1 : late - 1] = [blocker, giver]
    alpha, value = auction.slot_values(n, ratio), float(bids[giver])
    bound = auction.transfer_bound(value, early, late, bids[after], alpha)
    held_up = auction.utility(value, late, bids[before], alpha)
    for gift in (bound - 0.01, bound + 0.01):
        left, got = auction.transfer(value, float(bids[blocker]), gift)
        assert left + got == pytest.approx(value + bids[blocker])
        helped = auction.utility(left, early, bids[after], alpha)
        assert (helped > held_up) == (gift < bound)


@given(queued())
def test_the_order_takes_the_largest_head_each_time(case: tuple[Floats, Queues]) -> None:
    """Among all orders that respect the lanes it is the first by bid, then index, turn by turn."""
    bids, lines = case
    every = list(lane_respecting(lines))
    sizes = np.bincount(lines.lane)
    assert len(every) == math.factorial(len(bids)) // math.prod(math.factorial(size) for size in sizes)
    best = max(every, key=lambda order: [(bids[i], -i) for i in order])
    assert tuple(auction.lane_orders(bids[None], lines)[0].tolist()) == best


@given(queued(), ratios)
def test_without_overflow_the_order_maximises_welfare_among_all_that_respect_the_lanes(
    case: tuple[Floats, Queues], ratio: float
) -> None:
    bids, lines = case
    for lane in lines.slots:
        line = lane[lane < len(bids)]
        bids[line] = np.sort(bids[line])[::-1]
    alpha = auction.slot_values(len(bids), ratio)
    best = max(welfare(order, bids, alpha) for order in lane_respecting(lines))
    assert welfare(auction.lane_orders(bids[None], lines)[0], bids, alpha) == pytest.approx(best)


@given(queued(), ratios, st.floats(0.0, 1.0), st.data())
def test_transfers_move_bids_forward_within_their_bounds(
    case: tuple[Floats, Queues], ratio: float, share: float, data: st.DataObject
) -> None:
    bids, lines = case
    n = len(bids)
    group = np.array(data.draw(st.lists(st.sampled_from([OUTSIDE, 0, 1]), min_size=n, max_size=n)))
    made = auction.with_transfers(bids[None], lines, group, ratio, share)[0]
    assert made.sum() == pytest.approx(bids.sum())
    assert (made[group == OUTSIDE] == bids[group == OUTSIDE]).all()
    alpha = auction.slot_values(n + 1, ratio)
    for i in range(n):
        ahead = [j for j in range(n) if lines.lane[j] == lines.lane[i] and lines.place[j] < lines.place[i]]
        blocked = any(bids[j] < bids[i] or (bids[j] == bids[i] and j > i) for j in ahead)
        if not blocked:
            assert made[i] >= bids[i] - 1e-12  # who is not held up gives nothing
        # The loosest bound there is: everybody else passed at no cost.
        assert bids[i] - made[i] <= share * bids[i] * (1.0 - alpha[n]) + 1e-9


@given(values, st.integers(1, 40), st.lists(values, min_size=1, max_size=5), ratios)
def test_one_gift_is_the_share_of_the_bound_of_the_theorem(
    blocker: float, more: int, others: list[float], ratio: float
) -> None:
    """One lane of two overflows, the others hold one vehicle each: there the scalar bound applies."""
    bids = np.array([blocker, blocker + more / 10.0, *others])
    n = len(bids)
    lines = auction.queues(np.array([0, 0, *range(1, n - 1)]), np.arange(n, dtype=np.float64), np.arange(n))
    late = auction.lane_orders(bids[None], lines)[0].tolist().index(1)
    free = [i for i in auction.allocate(bids).tolist() if i != 0]
    early = 1 + free.index(1)
    after = [*free[: early - 1], 0, *free[early - 1 :]]
    bound = auction.transfer_bound(float(bids[1]), early, late, bids[after], auction.slot_values(n, ratio))
    made = auction.with_transfers(bids[None], lines, np.zeros(n, dtype=np.int64), ratio, 0.5)[0]
    assert bound >= -1e-12
    assert bids[1] - made[1] == pytest.approx(0.5 * bound, abs=1e-9)
    assert made[0] - bids[0] == pytest.approx(0.5 * bound, abs=1e-9)


@given(queued(), st.integers(1, 5), ratios, st.data())
def test_sequences_respect_lanes_and_differ(
    case: tuple[Floats, Queues], count: int, ratio: float, data: st.DataObject
) -> None:
    bids, lines = case
    n = len(bids)
    row = st.lists(values, min_size=n, max_size=n)
    several = np.array([bids, *data.draw(st.lists(row, min_size=count, max_size=count))])
    group = np.array(data.draw(st.lists(st.sampled_from([OUTSIDE, 0, 1]), min_size=n, max_size=n)))
    made = auction.sequences(several, lines, group, ratio, 0.5)
    assert 1 <= len(made) <= len(several)
    allowed = set(lane_respecting(lines))
    assert all(tuple(order.tolist()) in allowed for order in made)
    runs = {tuple(tuple(order[group[order] == label].tolist()) for label in (0, 1)) for order in made}
    assert len(runs) == len(made)
