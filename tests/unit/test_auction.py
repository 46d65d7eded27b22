"""The auction on cases small enough to work out by hand; the theorems are in `tests/property`."""

from __future__ import annotations

import numpy as np
import pytest

from gameopt_im.core import auction
from gameopt_im.core.auction import (
    allocate,
    distinct,
    lane_orders,
    prices,
    prices_of_order,
    queues,
    sequences,
    slot_values,
    transfer,
    transfer_bound,
    utility,
    with_transfers,
)
from gameopt_im.core.conflicts import OUTSIDE
from gameopt_im.core.snapshot import Floats, Ints

ALPHA = np.array([1.0, 0.5, 0.25])


def ints(*values: int) -> Ints:
    return np.array(values, dtype=np.int64)


def floats(*values: float) -> Floats:
    return np.array(values, dtype=np.float64)


def test_the_highest_bid_goes_first_and_ties_go_by_arrival() -> None:
    assert allocate(floats(1, 3, 2, 3)).tolist() == [1, 3, 2, 0]
    assert allocate(floats()).tolist() == []


def test_later_turns_are_worth_strictly_less() -> None:
    np.testing.assert_allclose(slot_values(4, 0.5), [1.0, 0.5, 0.25, 0.125])
    assert (np.diff(slot_values(260, 0.9)) < 0).all()


def test_payment_is_what_those_behind_lose() -> None:
    np.testing.assert_allclose(prices(floats(10, 4, 2), ALPHA), [4 * 0.5 + 2 * 0.25, 2 * 0.25, 0.0])
    assert prices(floats(7), floats(1)).tolist() == [0.0]
    assert prices(floats(), floats()).tolist() == []


def test_utility_is_value_less_payment() -> None:
    assert utility(10.0, 0, floats(10, 4, 2), ALPHA) == pytest.approx(10.0 - 2.5)
    assert utility(3.0, 1, floats(10, 4, 2), ALPHA) == pytest.approx(1.5 - 0.5)


def test_the_overflow_bound_by_hand() -> None:
    # Behind a bid of 1 the giver (10) is third; with its gift it passes the 4 and is second.
    assert transfer_bound(10.0, 1, 2, floats(1, 10, 4), ALPHA) == pytest.approx(10 * 0.5 - 4 * 0.25 / 0.5)
    assert transfer_bound(10.0, 1, 1, floats(1, 10, 4), ALPHA) == 0.0
    assert transfer(10.0, 1.0, 3.0) == (7.0, 4.0)


def test_queues_run_front_to_back() -> None:
    lines = queues(ints(7, 3, 7, 7), floats(30, 5, 10, 20), np.arange(4))
    assert lines.slots.tolist() == [[1, 4, 4], [2, 3, 0]]
    assert lines.lane.tolist() == [1, 0, 1, 1]
    assert lines.place.tolist() == [2, 0, 0, 1]
    assert queues(ints(), floats(), np.arange(0)).slots.shape == (0, 0)


def test_a_lane_goes_when_its_lowest_head_goes() -> None:
    lines = queues(ints(0, 0, 1, 1), floats(10, 20, 10, 20), np.arange(4))
    assert lane_orders(floats(1, 9, 5, 3)[None], lines).tolist() == [[2, 3, 0, 1]]
    assert lane_orders(floats(4, 9, 5, 3)[None], lines).tolist() == [[2, 0, 1, 3]]
    assert lane_orders(floats(2, 2, 2, 2)[None], lines).tolist() == [[0, 1, 2, 3]]


def test_equal_bids_keep_their_lane_even_where_the_later_arrival_is_ahead() -> None:
    lines = queues(ints(0, 1, 0), floats(20, 10, 10), np.arange(3))
    assert lane_orders(floats(2, 2, 2)[None], lines).tolist() == [[1, 2, 0]]


def test_a_blocked_bid_passes_a_share_of_its_bound_to_the_one_ahead() -> None:
    # Lane 0: 1 ahead of 10. Lane 1: 5. The 10 would pass the 5: bound 10 (1 - r) - 5 (1 - r) with r = 0.9.
    lines, group = queues(ints(0, 0, 1), floats(10, 20, 10), np.arange(3)), ints(0, 0, 0)
    made = with_transfers(floats(1, 10, 5)[None], lines, group, 0.9, 0.5)
    np.testing.assert_allclose(made, [[1.25, 9.75, 5.0]])
    bound = transfer_bound(10.0, 1, 2, floats(1, 10, 5), slot_values(3, 0.9))
    assert made[0, 0] - 1.0 == pytest.approx(0.5 * bound)


def test_a_transfer_can_turn_the_order() -> None:
    lines, group = queues(ints(0, 0, 1, 2, 3), floats(10, 20, 10, 10, 10), np.arange(5)), ints(0, 0, 0, 0, 0)
    bids = floats(2.0, 9.0, 2.1, 2.2, 2.3)[None]
    assert lane_orders(bids, lines).tolist() == [[4, 3, 2, 0, 1]]
    assert lane_orders(with_transfers(bids, lines, group, 0.5, 0.9), lines).tolist() == [[0, 1, 4, 3, 2]]


def test_the_gift_is_parted_among_all_who_are_in_the_way() -> None:
    lines, group = queues(ints(0, 0, 0, 1), floats(10, 20, 30, 10), np.arange(4)), ints(0, 0, 0, 0)
    made = with_transfers(floats(1, 2, 10, 5)[None], lines, group, 0.9, 0.5)
    # The 2 has nobody to pass between itself and the 1 it is held by: only the 10 gives.
    np.testing.assert_allclose(made, [[1.125, 2.125, 9.75, 5.0]])


def test_nobody_passes_its_own_lane() -> None:
    lines, group = queues(ints(0, 0, 0, 1), floats(10, 20, 30, 10), np.arange(4)), ints(0, 0, 0, 0)
    made = with_transfers(floats(3, 1, 10, 5)[None], lines, group, 0.9, 0.5)
    # The 10 would pass the 5; the 3 ahead of it goes earlier anyway.
    np.testing.assert_allclose(made, [[3.125, 1.125, 9.75, 5.0]])


@pytest.mark.parametrize(
    ("bids", "lane", "group", "share"),
    [
        (floats(10, 1, 5), ints(0, 0, 1), ints(0, 0, 0), 0.5),  # nobody is held up
        (floats(1, 10, 5), ints(0, 0, 1), ints(0, 0, 1), 0.5),  # nobody of its group to pass
        (floats(1, 10, 5), ints(0, 0, 1), ints(OUTSIDE, 0, 0), 0.5),  # the one ahead is in no auction
        (floats(1, 10, 5), ints(0, 0, 1), ints(0, OUTSIDE, 0), 0.5),  # the blocked one is in no auction
        (floats(1, 10, 5), ints(0, 0, 1), ints(0, 0, 0), 0.0),
    ],
)
def test_no_transfer_where_there_is_nothing_to_gain(bids: Floats, lane: Ints, group: Ints, share: float) -> None:
    made = with_transfers(bids[None], queues(lane, floats(10, 20, 10), np.arange(3)), group, 0.9, share)
    np.testing.assert_array_equal(made, bids[None])


def test_sequences_are_one_per_weight_vector_and_distinct() -> None:
    lines, group = queues(ints(0, 1, 2), floats(10, 10, 10), np.arange(3)), ints(0, 0, 0)
    bids = np.array([[3.0, 2.0, 1.0], [1.0, 2.0, 3.0], [6.0, 4.0, 2.0]])
    assert [order.tolist() for order in sequences(bids, lines, group, 0.9, 0.5)] == [[0, 1, 2], [2, 1, 0]]


def test_orders_that_run_every_group_alike_count_once() -> None:
    group = ints(0, 0, 1, OUTSIDE)
    orders = np.array([[0, 1, 2, 3], [3, 2, 0, 1], [2, 1, 0, 3]])
    assert distinct(orders, group).tolist() == [0, 2]


def test_an_empty_intersection_has_one_empty_sequence() -> None:
    made = sequences(np.zeros((8, 0)), queues(ints(), floats(), np.arange(0)), ints(), 0.9, 0.5)
    assert [order.tolist() for order in made] == [[]]


def test_prices_are_charged_within_the_group() -> None:
    group = ints(0, 1, 0, OUTSIDE, 1)
    bids = floats(10, 8, 4, 99, 2)
    charged = prices_of_order(ints(3, 0, 1, 2, 4), bids, group, 0.5)
    np.testing.assert_allclose(charged, [4 * 0.5, 2 * 0.5, 0.0, 0.0, 0.0])
    charged = prices_of_order(ints(2, 0, 4, 1, 3), bids, group, 0.5)
    np.testing.assert_allclose(charged, [0.0, 0.0, 10 * 0.5, 0.0, 8 * 0.5])


def test_one_giver_or_many_are_one_compilation() -> None:
    """Compiling takes seconds, which a control cycle has not: arguments are laid out alike whatever they hold."""
    lines, group = queues(ints(0, 0, 1), floats(10, 20, 10), np.arange(3)), ints(0, 0, 0)
    with_transfers(floats(1, 10, 5)[None], lines, group, 0.9, 0.5)
    compiled = len(auction._transferred.signatures)
    with_transfers(np.array([[1.0, 10.0, 5.0], [2.0, 9.0, 5.0]]), lines, group, 0.9, 0.5)
    assert len(auction._transferred.signatures) == compiled
