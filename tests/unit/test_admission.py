"""More vehicles than are answered for, and more messages than can be read: who is taken, and what is left out."""

from __future__ import annotations

import pytest
from tracking import ROADS, TERM, bid, fates, state, tracker

from gameopt_im.inbox import Raw, within
from gameopt_wire import codec, keys
from gameopt_wire.messages import State

MOST = 3


def raw(name: str, kind: str = "state", payload: bytes = b"") -> Raw:
    return Raw(kind, payload, keys.of_vehicle(ROADS.intersection, "state", name))  # type: ignore[arg-type]


def spoken(*states: State) -> list[Raw]:
    return [raw(each.vehicle, payload=codec.STATE.encode(each)) for each in states]


def test_of_newcomers_those_farthest_from_their_line_are_refused_whatever_came_first() -> None:
    vehicles = tracker(max_vehicles=MOST)
    for name, distance_m in (("d", 140.0), ("b", 120.0), ("e", 150.0), ("a", 80.0), ("c", 130.0)):
        vehicles.ingest_state(state(name, distance_m=distance_m), 10.0)
    assert sorted(vehicles.snapshot(100, 10.0).ids) == ["a", "b", "c"]
    assert dict(vehicles.rejected) == {"overload": 2}
    assert fates(vehicles.take_events()) == [("b", "entered"), ("a", "entered"), ("c", "entered")]


def test_who_is_there_stays_and_a_place_that_is_left_is_taken() -> None:
    vehicles = tracker(max_vehicles=1, stale_s=2.0)
    vehicles.ingest_state(state("far", distance_m=150.0), 10.0)
    vehicles.snapshot(100, 10.0)
    vehicles.take_events()
    vehicles.ingest_state(state("near", 10.1, distance_m=60.0), 10.1)
    assert vehicles.snapshot(101, 10.1).ids == ("far",)
    vehicles.ingest_state(state("near", 12.2, distance_m=60.0), 12.2)
    vehicles.snapshot(122, 12.2)  # the first one has been silent for too long
    vehicles.take_events()
    vehicles.ingest_state(state("near", 12.3, distance_m=60.0), 12.3)
    assert vehicles.snapshot(123, 12.3).ids == ("near",)


@pytest.mark.parametrize(
    "newcomer",
    [
        state("b", distance_m=140.0, term=TERM - 1, accepted=7),
        state("b", distance_m=-3.0),
        state("b", distance_m=5.0, speed_mps=15.0),
    ],
    ids=["follows a clearance", "in the zone", "cannot stop"],
)
def test_who_may_have_to_cross_is_never_refused(newcomer: State) -> None:
    vehicles = tracker(max_vehicles=1)
    vehicles.ingest_state(state("a", distance_m=20.0, speed_mps=0.0), 10.0)
    vehicles.snapshot(100, 10.0)
    vehicles.take_events()
    vehicles.ingest_state(newcomer, 10.0)
    assert sorted(vehicles.snapshot(100, 10.0).ids) == ["a", "b"]
    assert not vehicles.rejected


def test_but_not_without_end() -> None:
    vehicles = tracker(max_vehicles=MOST)
    for k in range(100):
        vehicles.ingest_state(state(f"liar {k}", accepted=k), 10.0)
    assert len(vehicles.snapshot(100, 10.0)) == 3 * MOST
    assert dict(vehicles.rejected) == {"overload": 100 - 3 * MOST}


def test_a_table_full_of_strangers_bids_keeps_nobody_who_is_there_from_bidding() -> None:
    vehicles = tracker(max_vehicles=MOST)
    vehicles.ingest_state(state("here"), 10.0)
    for k in range(10):
        vehicles.ingest_bid(bid(f"stranger {k}"), 10.0)
    assert vehicles.ingest_bid(bid("here", assertiveness=4.0), 10.0) is None
    assert vehicles.snapshot(100, 10.0).assertiveness[0] == 4.0


def test_few_messages_are_left_as_they_are() -> None:
    messages = [raw("a"), raw("b")]
    assert within(messages, 2, ()) == (messages, 0)


def test_of_too_many_messages_those_of_vehicles_that_are_there_are_read_and_the_newest_of_the_others() -> None:
    messages = [raw("here"), raw("x1"), raw("x2"), raw("gone", "gone"), raw("x3")]
    assert within(messages, 3, {"here"}) == ([raw("here"), raw("gone", "gone"), raw("x3")], 2)
    assert within(messages, 1, {"here"}) == ([raw("here")], 3)
    assert within([raw("here", payload=bytes([k])) for k in range(9)], 2, {"here"}) == (
        [raw("here", payload=b"\x07"), raw("here", payload=b"\x08")],
        7,
    )


def test_what_has_been_read_before_is_on_the_account_of_those_who_are_not_there() -> None:
    messages = [raw("here"), raw("x1"), raw("x2"), raw("x3")]
    assert within(messages, 5, {"here"}, read=1) == (messages, 0)
    assert within(messages, 5, {"here"}, read=2) == ([raw("here"), raw("x2"), raw("x3")], 1)
    assert within(messages, 5, {"here"}, read=5) == ([raw("here")], 3)


def test_a_control_cycle_reads_no_more_for_reading_ahead() -> None:
    vehicles = tracker("wall", max_vehicles=MOST)
    flood = [raw(f"junk {k}", payload=b"\xc1") for k in range(3 * MOST)]
    assert vehicles.has_room(2 * MOST)
    for _ in range(MOST):
        vehicles.ingest(flood[:1], 10.0)
    assert vehicles.has_room(MOST)
    assert not vehicles.has_room(MOST + 1)
    vehicles.ingest(flood, 10.0)
    assert (vehicles.rejected["malformed"], vehicles.rejected["flood"]) == (2 * MOST, 2 * MOST)
    vehicles.snapshot(100, 10.0)
    assert vehicles.has_room(2 * MOST)


def test_a_flood_is_counted_and_not_read_and_whoever_is_there_is_heard() -> None:
    vehicles = tracker("wall", max_vehicles=MOST)
    vehicles.ingest(spoken(state("here")), 10.0)
    vehicles.snapshot(100, 10.0)
    junk = [raw(f"junk {k}", payload=b"\xc1") for k in range(1000)]
    vehicles.ingest(spoken(state("here", 10.1, distance_m=98.0)) + junk, 10.1)
    assert vehicles.snapshot(101, 10.1).s[0] == 98.0
    assert vehicles.received == 1 + 1 + 1000
    assert dict(vehicles.rejected) == {"flood": 1000 - 5, "malformed": 5}


def test_a_lock_step_reads_all_that_it_waited_for() -> None:
    vehicles = tracker("lockstep", max_vehicles=MOST)
    vehicles.ingest([raw(f"junk {k}", payload=b"\xc1") for k in range(1000)], 10.0)
    assert dict(vehicles.rejected) == {"malformed": 1000}
