"""What the interlock makes of vehicles it has not heard: where they may be at worst, and who must wait for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import ACROSS, GROUND, limits_of, picture_of, snapshot

from gameopt_im.core import interlock
from gameopt_im.core.granting import NO_SLOT, grant
from gameopt_im.core.interlock import CLEARED, EXITING, INTRUDING, UNCLEARED
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.core.windows import HORIZON
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

PARAMETERS = Parameters()
CLEAR_X = float(GROUND.clear[ACROSS]) + 5.0
"""Here the front of a car is when its rear stands clear."""


def silent(age: float, **columns: Any) -> Snapshot:
    """One car last heard `age` s ago; `s` and `v` are what was predicted."""
    return snapshot(age=[age], silent=[age > STEP_S], **columns)


def holding(cars: Snapshot, *, accepted: bool) -> Book:
    """The first car holds a clearance: 10 m/s from 30 m before the line, 5 m/s in the worst case."""
    times = np.arange(HORIZON) * STEP_S
    book = Book()
    book.add(
        Reservation(
            vehicle=cars.ids[0], clearance=1, start=0, movement=ACROSS, footprint=0, lane=ACROSS, length=5.0, b=4.5,
            x=-30.0 + 10.0 * times, v=np.full(HORIZON, 10.0), late_x=-30.0 + 5.0 * times,
            late_v=np.full(HORIZON, 5.0), done=60, start_s=0.0, expires_s=0.5, accepted=accepted,
        )
    )  # fmt: skip
    return book


def at_worst(cars: Snapshot, book: Book) -> tuple[float, float]:
    phase = interlock.phases(cars, GROUND, book)
    x, v = interlock.at_worst(cars, GROUND, book, phase, PARAMETERS.exit)
    return float(x[0]), float(v[0])


@pytest.mark.parametrize(
    ("accepted", "heard_s", "phase"),
    [(True, 20.0, CLEARED), (False, 20.0, UNCLEARED), (True, -CLEAR_X, EXITING)],
)
def test_a_phase_follows_from_what_was_heard(accepted: bool, heard_s: float, phase: int) -> None:
    cars = silent(6.0, s=[-CLEAR_X - 20.0], heard_s=[heard_s])
    assert interlock.phases(cars, GROUND, holding(cars, accepted=accepted)).tolist() == [phase]


def test_who_could_not_stop_when_heard_intrudes_whatever_is_predicted() -> None:
    cars = silent(3.0, s=[1.0], v=[0.0], heard_s=[11.0], heard_v=[10.0])
    assert interlock.phases(cars, GROUND, Book()).tolist() == [INTRUDING]


def test_an_uncleared_vehicle_has_braked_fully_at_worst() -> None:
    cars = silent(1.0, s=[80.0], heard_s=[90.0])
    assert at_worst(cars, Book()) == pytest.approx((-90.0 + 10.0 - 4.5 / 2, 5.5))
    cars = silent(9.0, s=[1.0], v=[0.0], heard_s=[90.0], heard_v=[10.0])
    assert at_worst(cars, Book()) == pytest.approx((-90.0 + 100.0 / 9.0, 0.0))


def test_a_cleared_vehicle_is_in_its_worst_case_at_worst() -> None:
    cars = silent(2.0, s=[0.0], heard_s=[20.0], cycle=30)
    assert at_worst(cars, holding(cars, accepted=True)) == pytest.approx((-15.0, 5.0))


def test_an_exiting_vehicle_has_opened_its_headway_at_worst() -> None:
    slowest = motion.OPENING_FLOOR * float(GROUND.exit_mps[ACROSS])
    cars = silent(4.0, s=[-100.0], heard_s=[-CLEAR_X], heard_v=[slowest + 3.0])
    decel = PARAMETERS.exit.decel_mps2
    braking = 3.0 / decel
    way = (slowest + 1.5) * braking + slowest * (4.0 - braking)
    assert at_worst(cars, Book()) == pytest.approx((CLEAR_X + way, slowest))


def test_a_follower_keeps_rule_2_behind_where_its_leader_may_be() -> None:
    cars = snapshot(s=[40.0, 70.0], v=[10.0, 15.0], age=[1.0, 0.0], heard_s=[50.0, 70.0])
    gap = 70.0 - (50.0 - 10.0 + 4.5 / 2) - 5.0 - motion.REAR_GAP_M
    expected = motion.follow_speed(gap, 15.0, 4.5, 5.5, 4.5, STEP_S)
    assert limits_of(cars, Book()).follow[1] == pytest.approx(expected)


def test_who_was_not_heard_may_have_become_faster() -> None:
    assert limits_of(silent(0.5, s=[80.0]), Book()).top[0] == pytest.approx(10.0 + 2.6 * 0.6)


@pytest.mark.parametrize(
    ("gap", "refused"),
    [
        (np.inf, False),  # nobody ahead
        (42.0, False),  # past the line: somebody's rear who has crossed
        (34.0, True),  # on the approach, where the manager knows of nobody
    ],
)
def test_nobody_is_cleared_behind_a_vehicle_that_was_never_heard(gap: float, refused: bool) -> None:
    cars = snapshot(s=[40.0], gap=[gap])
    book = Book()
    picture = picture_of(cars, book)
    given = grant(
        cars, GROUND, book, picture.limits, picture.scene, np.arange(1), np.array([NO_SLOT]),
        np.ones(1, dtype=np.bool_), PARAMETERS, 1,
    ).given  # fmt: skip
    assert (not given) is refused


@pytest.mark.parametrize(("gap", "unheard"), [(25.0, False), (23.1, False), (15.0, True)])
def test_the_leader_seen_is_the_leader_known(gap: float, unheard: bool) -> None:
    cars = snapshot(s=[10.0, 40.0], gap=[np.inf, gap])  # 25 m from bumper to bumper
    assert limits_of(cars, Book()).unheard.tolist() == [False, unheard]


@pytest.mark.parametrize("age", [0.0, 0.1, 0.3])
def test_a_worst_case_is_brought_up_to_date_by_every_state_once_however_late_it_comes(age: float) -> None:
    heard = {"heard_s": [10.0 + 10.0 * age]}
    cars = snapshot(s=[10.0], cycle=20, age=[age], **heard)
    book = holding(cars, accepted=True)
    before = book.held["a"].late_x.copy()
    picture_of(cars, book)
    assert not (book.held["a"].late_x == before).all()
    book.rows.late_x[book.row["a"]] = before
    picture_of(snapshot(s=[9.0], cycle=21, age=[age + 0.1], **heard), book)
    assert (book.held["a"].late_x == before).all()


def test_who_has_slipped_behind_is_found_out_by_late_states_too() -> None:
    """On a link that takes a control cycle no state is ever fresh; a truck slipped by 4 m and was never missed."""
    for slip_m in (0.0, 1.0):
        cars = snapshot(s=[10.0 + slip_m], cycle=20, age=[0.1], heard_s=[11.0 + slip_m])
        book = holding(cars, accepted=True)
        book.rows.late_x[book.row["a"]] = book.rows.x[book.row["a"]]  # nobody ahead could hold it up
        assert picture_of(cars, book).strayed == (("a",) if slip_m else ())


def test_who_is_silent_is_not_taken_to_have_overtaken() -> None:
    cars = snapshot(s=[30.0, 20.0], v=[2.0, 10.0], age=[0.0, 3.0], heard_s=[30.0, 50.0])
    assert limits_of(cars, Book()).leader[0] == -1
    bound = snapshot(s=[-30.0, -40.0], v=[2.0, 10.0], age=[0.0, 7.0], heard_s=[-30.0, 30.0])
    assert limits_of(bound, Book()).downstream[0] == -1


def test_a_silent_leader_may_be_further_on_than_the_vehicle_seen() -> None:
    """By its profile it is at 0 m; who is seen at 15 m may be somebody that was never heard."""
    cars = snapshot(s=[5.0, 40.0], v=[5.0, 10.0], age=[0.5, 0.0], heard_s=[7.5, 40.0], cycle=30, gap=[np.inf, 20.0])
    assert limits_of(cars, holding(cars, accepted=True)).unheard.tolist() == [False, True]
