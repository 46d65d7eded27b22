"""Where the manager thinks a vehicle is that it has not heard, and when it lets go of one."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from tracking import CLEAR_M, LENGTH_M, ROADS, SERVICE, TERM, fates, state, tracker, with_exits_of

from gameopt_im.core.conflicts import ground
from gameopt_im.core.interlock import INTRUDING, UNCLEARED, phases
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import FOREIGN
from gameopt_im.inbox import Raw
from gameopt_im.tracker import Event
from gameopt_wire import keys
from gameopt_wire.messages import Clock


def test_an_old_state_is_predicted_at_constant_speed() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(time_s=10.0), 10.0)
    shown = vehicles.snapshot(104, 10.4)
    assert (shown.s[0], shown.v[0]) == (pytest.approx(94.0), 15.0)
    assert shown.age[0] == pytest.approx(0.4)
    assert shown.silent[0]


@pytest.mark.parametrize(
    ("clock", "age_s", "silent"),
    [("lockstep", 0.1, False), ("lockstep", 0.2, True), ("wall", 0.149, False), ("wall", 0.2, True)],
)
def test_a_vehicle_is_silent_once_its_state_is_too_old(clock: Clock, age_s: float, silent: bool) -> None:
    vehicles = tracker(clock)
    vehicles.ingest_state(state(time_s=1_700_000_000.0), 1_700_000_000.0)
    assert vehicles.snapshot(1, 1_700_000_000.0 + age_s).silent[0] == silent


def test_an_uncleared_vehicle_is_predicted_to_stop_before_the_line() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(distance_m=26.0, speed_mps=15.0), 10.0)  # on rule 1's curve: 25 m to a stand
    half_way = vehicles.snapshot(110, 11.0)
    assert half_way.s[0] == pytest.approx(11.0)
    assert half_way.v[0] <= np.sqrt(2 * 4.5 * 10.0) + 1e-9
    at_rest = vehicles.snapshot(119, 11.9)
    assert (at_rest.s[0], at_rest.v[0]) == (1.0, 0.0)


def test_an_uncleared_vehicle_is_predicted_to_stop_before_its_setback() -> None:
    movements = [msgspec.structs.replace(each, setback_m=[3.0] * len(ROADS.footprints)) for each in ROADS.movements]
    vehicles = tracker(roads=msgspec.structs.replace(ROADS, movements=movements))
    vehicles.ingest_state(state(distance_m=29.0, speed_mps=15.0), 10.0)
    at_rest = vehicles.snapshot(119, 11.9)
    assert (at_rest.s[0], at_rest.v[0]) == (4.0, 0.0)
    assert (at_rest.heard_s[0], at_rest.heard_v[0]) == (29.0, 15.0)


def test_a_cleared_vehicle_is_predicted_over_the_line() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state("says", distance_m=26.0, accepted=4, term=TERM), 10.0)
    vehicles.ingest_state(state("booked", distance_m=26.0), 10.0)
    shown = vehicles.snapshot(119, 11.9, reserved={"booked"})
    assert shown.s.tolist() == pytest.approx([26.0 - 15.0 * 1.9] * 2)


def test_a_state_from_within_the_collecting_time_is_taken_back_to_the_grid_point() -> None:
    vehicles = tracker("wall")
    vehicles.ingest_state(state("after", time_s=10.02), 10.0)
    vehicles.ingest_state(state("wrong clock", time_s=10.9), 10.0)
    shown = vehicles.snapshot(100, 10.0)
    assert shown.s.tolist() == pytest.approx([100.3, 101.5])  # one step back at most
    assert shown.age.tolist() == [0.0, 0.0]


def test_a_clearance_of_another_term_is_not_shown_as_ours() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state("ours", accepted=4, term=TERM), 10.0)
    vehicles.ingest_state(state("theirs", accepted=4, term=TERM - 1), 10.0)
    assert vehicles.snapshot(100, 10.0).accepted.tolist() == [4, FOREIGN]


def test_a_silent_vehicle_that_could_stop_is_left_out_after_a_while() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(), 10.0)
    assert len(vehicles.snapshot(120, 10.0 + SERVICE.stale_s)) == 1
    assert len(vehicles.snapshot(121, 10.1 + SERVICE.stale_s)) == 0
    assert fates(vehicles.take_events()) == [("a", "entered"), ("a", "stale")]


@pytest.mark.parametrize(
    "changes",
    [
        {"accepted": 1, "term": TERM},
        {"distance_m": 20.0, "speed_mps": 15.0},  # 25 m to a stand
        {"distance_m": -10.0, "speed_mps": 0.0},  # in the conflict zone
        {"distance_m": -(CLEAR_M + LENGTH_M - 0.1), "speed_mps": 0.0},  # its rear still is
    ],
)
def test_a_silent_vehicle_that_may_be_in_the_way_is_held_but_not_for_ever(changes: dict[str, Any]) -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(**changes), 10.0)
    held = vehicles.snapshot(400, 10.0 + SERVICE.hold_s)
    assert held.silent.tolist() == [True]
    assert len(vehicles.snapshot(401, 10.1 + SERVICE.hold_s)) == 0
    assert fates(vehicles.take_events()) == [("a", "entered"), ("a", "lost")]


def test_a_silent_vehicle_with_a_reservation_is_held() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(), 10.0)
    assert len(vehicles.snapshot(200, 20.0, reserved={"a"})) == 1
    assert len(vehicles.snapshot(201, 20.1)) == 0


def test_moving_on_at_constant_speed_does_not_let_a_lost_vehicle_leave() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(distance_m=-10.0, speed_mps=15.0), 10.0)
    assert len(vehicles.snapshot(390, 39.0)) == 1  # by its last speed it would be 425 m past the line


@pytest.mark.parametrize(
    ("exit_m", "distance_m"),
    [(300.0, -(CLEAR_M + LENGTH_M + 260.0)), (100.0, -120.0), (3.0, -(CLEAR_M + LENGTH_M))],
)
def test_a_vehicle_through_its_exit_stretch_has_left_and_does_not_enter_again(exit_m: float, distance_m: float) -> None:
    vehicles = tracker(roads=with_exits_of(exit_m))
    vehicles.ingest_state(state(time_s=10.0, distance_m=distance_m + 1.0), 10.0)
    assert len(vehicles.snapshot(100, 10.0)) == 1
    vehicles.ingest_state(state(time_s=10.1, distance_m=distance_m), 10.1)
    assert len(vehicles.snapshot(101, 10.1)) == 0
    assert vehicles.ingest_state(state(time_s=10.2, distance_m=distance_m - 1.0), 10.2) is None
    assert len(vehicles.snapshot(102, 10.2)) == 0
    entered, left = vehicles.take_events()
    assert (entered.kind, left) == ("entered", Event("left", "a", 10.1, entered_s=10.0, heard_s=10.1))
    assert vehicles.take_events() == []


def test_a_vehicle_last_heard_clear_of_the_zone_leaves_by_prediction() -> None:
    vehicles = tracker()
    vehicles.ingest_state(state(distance_m=-(CLEAR_M + LENGTH_M), speed_mps=20.0), 10.0)
    assert len(vehicles.snapshot(229, 22.9)) == 1
    assert len(vehicles.snapshot(231, 23.1)) == 0
    assert fates(vehicles.take_events())[-1] == ("a", "left")


def test_a_late_copy_of_a_vehicle_that_has_left_is_no_new_arrival() -> None:
    vehicles = tracker("wall")
    last = state(time_s=10.0, distance_m=-(CLEAR_M + LENGTH_M + 1.0))
    vehicles.ingest_state(last, 10.0)
    vehicles.vanish("a")
    vehicles.snapshot(101, 10.1)
    assert fates(vehicles.take_events()) == [("a", "entered"), ("a", "left")]
    assert vehicles.ingest_state(last, 10.2) == "duplicate"
    assert vehicles.ingest_state(state(time_s=9.9), 10.2) == "stale"
    assert len(vehicles.snapshot(102, 10.2)) == 0
    assert vehicles.ingest_state(state(time_s=10.3), 10.3) is None  # who comes again says something new


def test_a_vanished_token_silences_at_once_until_heard_again() -> None:
    vehicles = tracker("wall")
    vehicles.ingest_state(state(time_s=10.0), 10.0)
    vehicles.ingest([Raw("gone", b"", keys.alive("x", "a")), Raw("gone", b"", keys.alive("x", "nobody"))], 10.0)
    assert vehicles.snapshot(100, 10.0).silent.tolist() == [True]
    vehicles.ingest_state(state(time_s=10.1), 10.1)
    assert vehicles.snapshot(101, 10.1).silent.tolist() == [False]


def test_a_vanished_token_past_the_zone_is_a_vehicle_that_has_left() -> None:
    vehicles = tracker("wall")
    vehicles.ingest_state(state(distance_m=-100.0), 10.0)
    vehicles.vanish("a")
    assert len(vehicles.snapshot(100, 10.0)) == 0
    assert fates(vehicles.take_events())[-1] == ("a", "left")


def test_lock_step_does_not_depend_on_when_a_token_vanishes() -> None:
    vehicles = tracker("lockstep")
    vehicles.ingest_state(state(), 10.0)
    vehicles.vanish("a")
    assert vehicles.snapshot(100, 10.0).silent.tolist() == [False]


def test_a_vehicle_on_a_predecessors_clearance_intrudes() -> None:
    """It will cross whatever it is told, so the ground ahead of it is kept, long before it could not stop."""
    vehicles = tracker()
    vehicles.ingest_state(state("theirs", distance_m=100.0, accepted=4, term=TERM - 1), 10.0)
    vehicles.ingest_state(state("nobodys", distance_m=100.0), 10.0)
    shown = vehicles.snapshot(100, 10.0)
    ground_ = ground(with_exits_of(300.0), "areas", 25.0, turn_speed=True)
    phase = dict(zip(shown.ids, phases(shown, ground_, Book()).tolist(), strict=True))
    assert phase == {"theirs": INTRUDING, "nobodys": UNCLEARED}
