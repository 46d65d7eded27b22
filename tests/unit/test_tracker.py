"""What the manager makes of states and bids: whom it takes in, and how they stand in the snapshot."""

from __future__ import annotations

from typing import Any

import pytest
from tracking import LENGTH_M, ROADS, SERVICE, TERM, bid, fates, state, tracker

from gameopt_im.core.snapshot import NONE
from gameopt_im.inbox import Raw
from gameopt_wire import codec, keys
from gameopt_wire.messages import State


def raw_state(message: State, key_vehicle: str | None = None) -> Raw:
    key = keys.of_vehicle(ROADS.intersection, "state", key_vehicle or message.vehicle)
    return Raw("state", codec.STATE.encode(message), key)


def test_nobody_there_is_an_empty_snapshot() -> None:
    snapshot = tracker().snapshot(1, 0.1)
    assert len(snapshot) == 0
    assert snapshot.v_max.shape == snapshot.accepted.shape == snapshot.silent.shape == (0,)


def test_a_fresh_state_is_shown_as_it_is() -> None:
    vehicles = tracker()
    assert vehicles.ingest_state(state(movement="2-1", length_m=9.0, width_m=2.5), 10.0) is None
    shown = vehicles.snapshot(100, 10.0)
    assert (shown.cycle, shown.time_s, shown.ids) == (100, 10.0, ("a",))
    assert (shown.s[0], shown.v[0], shown.length[0]) == (100.0, 15.0, 9.0)
    assert (shown.a_max[0], shown.b_max[0]) == (2.6, 4.5)
    assert (shown.movement[0], shown.lane[0], shown.footprint[0]) == (2, 1, 1)
    assert (shown.accepted[0], shown.silent[0], shown.age[0], shown.waited[0]) == (-1, False, 0.0, 0.0)


def test_the_speed_limit_is_the_approach_lanes_then_the_exits() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state("approaching"), 10.0)
    vehicles.ingest_state(state("leaving", distance_m=-1.0), 10.0)
    vehicles.ingest_state(state("slow", max_speed_mps=8.0), 10.0)
    shown = vehicles.snapshot(100, 10.0)
    assert dict(zip(shown.ids, shown.v_max.tolist(), strict=True)) == {
        "approaching": 20.0,
        "leaving": 15.0,
        "slow": 8.0,
    }


def test_vehicles_stand_in_order_of_entry_then_id() -> None:
    vehicles = tracker()
    for name, time_s in (("c", 10.0), ("b", 10.0), ("a", 10.1)):
        vehicles.ingest_state(state(name, time_s), 10.1)
    assert vehicles.snapshot(101, 10.1).ids == ("b", "c", "a")


def test_waiting_runs_from_the_first_state_whatever_the_vehicle_says_later() -> None:
    vehicles = tracker()
    for step in range(31):
        vehicles.ingest_state(state(time_s=10.0 + step / 10, distance_m=100.0 - step), 10.0 + step / 10)
    assert vehicles.snapshot(130, 13.0).waited[0] == pytest.approx(3.0)


def test_the_latest_state_wins_in_any_order_of_arrival() -> None:
    vehicles = tracker()
    assert vehicles.ingest_state(state(time_s=10.1, distance_m=98.0), 10.1) is None
    assert vehicles.ingest_state(state(time_s=10.0, distance_m=100.0), 10.1) == "stale"
    assert vehicles.ingest_state(state(time_s=10.1, distance_m=50.0), 10.1) == "duplicate"
    assert vehicles.snapshot(101, 10.1).s[0] == 98.0
    assert (vehicles.received, dict(vehicles.rejected)) == (3, {"stale": 1, "duplicate": 1})


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"movement": "9-9"}, "unknown_movement"),
        ({"length_m": 12.5}, "uncovered"),
        ({"width_m": 2.7}, "uncovered"),
        ({"distance_m": 150.0 + 51.0}, "out_of_range"),
        ({"distance_m": -(20.0 + 300.0 + LENGTH_M + 51.0)}, "out_of_range"),
        ({"time_s": 11.1}, "time"),
        ({"time_s": 10.0 - SERVICE.stale_s - 0.1}, "time"),
    ],
)
def test_a_state_that_cannot_be_is_not_taken(changes: dict[str, Any], reason: str) -> None:
    vehicles = tracker()
    assert vehicles.ingest_state(state(**changes), 10.0) == reason
    assert len(vehicles.snapshot(100, 10.0)) == 0
    assert dict(vehicles.rejected) == {reason: 1}


def test_messages_are_read_and_counted_whatever_they_are() -> None:
    vehicles = tracker()
    good = raw_state(state("car/1"))
    vehicles.ingest(
        [
            good,
            good,
            raw_state(state("b"), key_vehicle="a"),
            Raw("state", b"\xc1", keys.of_vehicle("x", "state", "a")),
            Raw("bid", codec.BID.encode(bid("car/1", assertiveness=4.0)), "gameopt/x/bid/car%2F1"),
            Raw("bid", good.payload, good.key),
        ],
        10.0,
    )
    assert vehicles.received == 6
    assert dict(vehicles.rejected) == {"duplicate": 1, "key": 1, "malformed": 1, "out_of_range": 1}
    assert vehicles.snapshot(100, 10.0).assertiveness[0] == 4.0


def test_without_a_bid_a_vehicle_bids_the_least_of_its_class() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(vehicle_class="emergency"), 10.0)
    shown = vehicles.snapshot(100, 10.0)
    assert (shown.assertiveness[0], shown.speed_priority[0], shown.variation_priority[0]) == (7.0, 4.0, 0.5)


@pytest.mark.parametrize("bid_first", [True, False])
def test_a_bid_holds_whether_it_comes_before_or_after_the_state(bid_first: bool) -> None:
    vehicles = tracker()
    arrivals = [lambda: vehicles.ingest_bid(bid(assertiveness=3.0), 10.0)]
    arrivals.insert(1 if bid_first else 0, lambda: vehicles.ingest_state(state(), 10.0))
    for arrive in arrivals:
        arrive()
    shown = vehicles.snapshot(100, 10.0)
    assert shown.assertiveness[0] == 3.0
    assert shown.speed_priority[0] == pytest.approx(1.0)  # half way between the bounds of passenger
    assert shown.variation_priority[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("declared", "counts"), [(0.0, 1.0), (99.0, 5.0)])
def test_a_bid_is_clipped_to_the_range_of_its_class(declared: float, counts: float) -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(vehicle_class="tricycle"), 10.0)  # not configured: counts as passenger
    vehicles.ingest_bid(bid(assertiveness=declared), 10.0)
    assert vehicles.snapshot(100, 10.0).assertiveness[0] == counts


def test_the_latest_bid_wins() -> None:
    vehicles = tracker()
    assert vehicles.ingest_bid(bid(time_s=10.1, assertiveness=4.0), 10.1) is None
    assert vehicles.ingest_bid(bid(time_s=10.0, assertiveness=2.0), 10.1) == "stale"
    assert vehicles.ingest_bid(bid(time_s=10.1, assertiveness=2.0), 10.1) == "duplicate"
    assert vehicles.ingest_bid(bid(time_s=12.0), 10.1) == "time"
    assert (vehicles.bids, vehicles.received) == (1, 4)


def test_bids_of_vehicles_that_never_come_do_not_pile_up() -> None:
    vehicles = tracker(max_vehicles=2)
    assert [vehicles.ingest_bid(bid(name), 10.0) for name in "abc"] == [None, None, "overload"]
    vehicles.snapshot(130, 10.0 + SERVICE.stale_s + 1.0)
    assert vehicles.ingest_bid(bid("c", 13.0), 13.0) is None


@pytest.mark.parametrize("changes", [{"movement": "0-0"}, {"length_m": 12.0}, {"width_m": 2.5}])
def test_a_vehicle_with_a_clearance_keeps_its_way_and_its_size(changes: dict[str, Any]) -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(accepted=1, term=TERM), 10.0)
    assert vehicles.ingest_state(state(time_s=10.1, accepted=1, term=TERM, **changes), 10.1) == "changed"


def test_so_does_one_that_was_offered_a_clearance_in_this_very_control_cycle() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(), 10.0)
    vehicles.snapshot(100, 10.0)
    vehicles.reserved = {"a"}
    assert vehicles.ingest_state(state(time_s=10.1, length_m=12.0), 10.1) == "changed"


def test_a_vehicle_without_a_clearance_may_change_its_movement_and_keeps_its_entry() -> None:
    vehicles = tracker()
    vehicles.ingest_bid(bid(assertiveness=4.0), 10.0)
    vehicles.ingest_state(state(), 10.0)
    assert vehicles.ingest_state(state(time_s=10.1, movement="0-0"), 10.1) is None
    shown = vehicles.snapshot(101, 10.1)
    assert (shown.movement[0], shown.assertiveness[0], shown.waited[0]) == (1, 4.0, pytest.approx(0.1))
    assert fates(vehicles.take_events()) == [("a", "entered")]


def test_vehicles_on_their_own_are_counted() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state("a", fallback=True), 10.0)
    vehicles.ingest_state(state("b"), 10.0)
    vehicles.snapshot(100, 10.0)
    assert vehicles.fallbacks == 1


def test_what_was_heard_last_is_there_for_the_asking() -> None:
    vehicles, said = tracker(), state(fallback=True)
    vehicles.ingest_state(said, 10.0)
    known = vehicles.vehicle("a")
    assert known is not None
    assert known.body == (said.movement, said.length_m, said.width_m, said.vehicle_class)
    assert (known.last.time, known.last.s, known.last.v) == (said.time_s, said.distance_m, said.speed_mps)
    assert (known.last.accepted, known.last.fallback) == (NONE, True)
    assert vehicles.vehicle("b") is None


def test_after_a_reset_time_may_begin_anew() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(time_s=360.0), 360.0)
    vehicles.reset()
    assert vehicles.ingest_state(state(time_s=0.1), 0.1) is None
    shown = vehicles.snapshot(1, 0.1)
    assert (shown.ids, shown.waited[0]) == (("a",), 0.0)
    assert fates(vehicles.take_events()) == [("a", "entered")]
