"""What becomes of offers: taken, lapsed, kept for who is silent, left behind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import ACROSS, GROUND, picture_of, snapshot

from gameopt_im.core import decision
from gameopt_im.core.decision import Settled, Winner
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Floats, Snapshot
from gameopt_im.core.windows import HORIZON

EXPIRES_S = 10.0


def offered(**changes: Any) -> Book:
    """A book with one offer, clearance 7, for vehicle a."""
    way = -40.0 + np.arange(HORIZON)
    values: dict[str, Any] = {
        "vehicle": "a", "clearance": 7, "start": 0, "movement": ACROSS, "footprint": 0, "lane": ACROSS, "length": 5.0,
        "b": 4.5, "x": way, "v": np.full(HORIZON, 10.0), "late_x": way, "late_v": np.full(HORIZON, 10.0), "done": 70,
        "start_s": EXPIRES_S - 0.5, "expires_s": EXPIRES_S,
    }  # fmt: skip
    book = Book()
    book.add(Reservation(**(values | changes)))
    return book


def settled(book: Book, **columns: Any) -> Settled:
    return decision.settle(book, snapshot(**({"s": [40.0]} | columns)), GROUND)


def names(each: tuple[Reservation, ...]) -> list[str]:
    return [reservation.vehicle for reservation in each]


def test_an_offer_that_its_vehicle_names_is_accepted() -> None:
    book = offered()
    made = settled(book, time_s=EXPIRES_S, accepted=[7])
    assert (names(made.accepted), made.lapsed, made.left) == (["a"], (), ())
    assert book.held["a"].accepted
    assert settled(book, time_s=EXPIRES_S + 9.0, accepted=[7]) == Settled((), (), (), ())  # once only, and for good


@pytest.mark.parametrize("named", [-1, 6])
def test_an_offer_lapses_when_a_state_after_its_expiry_does_not_name_it(named: int) -> None:
    book = offered()
    assert settled(book, time_s=EXPIRES_S, accepted=[named]) == Settled((), (), (), ())
    assert names(settled(book, time_s=EXPIRES_S + 0.1, accepted=[named]).lapsed) == ["a"]
    assert not book.held


def test_a_silent_vehicle_keeps_its_ground() -> None:
    book = offered()
    heard_last = {"silent": [True], "age": [1.0]}
    assert settled(book, time_s=EXPIRES_S + 0.9, **heard_last) == Settled((), (), (), ())
    assert list(book.held) == ["a"]
    assert names(settled(book, time_s=EXPIRES_S + 0.9).lapsed) == ["a"]


def test_the_ground_is_free_once_the_rear_has_left_it() -> None:
    book = offered(accepted=True)
    assert settled(book, s=[-26.9], accepted=[7]) == Settled((), (), (), ())  # clear at 22 m, 5 m long
    predicted = {"heard_s": [-26.9], "silent": [True], "age": [0.2]}  # it may have been held up
    assert settled(book, s=[-28.9], accepted=[7], **predicted) == Settled((), (), (), ())
    assert names(settled(book, s=[-27.1], accepted=[7]).left) == ["a"]
    assert not book.held


def test_who_is_lost_and_who_intruded_hold_nothing() -> None:
    for book, ids in ((offered(), ("b",)), (offered(clearance=0), ("a",))):
        assert settled(book, ids=ids) == Settled((), (), (), ())
        assert not book.held


def test_a_clearance_asked_back_is_free_once_its_vehicle_says_so() -> None:
    book = offered(accepted=True)
    book.withdraw("a")
    assert settled(book, accepted=[7], s=[5.0]) == Settled((), (), (), ())
    assert names(settled(book, accepted=[-1], s=[5.0]).returned) == ["a"]
    assert not book.held


def test_nobody_holds_ground_it_says_it_has_no_clearance_for() -> None:
    """The manager may have stopped asking before a late command made the vehicle drop it."""
    assert settled(offered(accepted=True), accepted=[-1], s=[5.0]) == Settled((), (), (), ())  # it cannot stop
    assert names(settled(offered(accepted=True), accepted=[-1], s=[40.0]).returned) == ["a"]


def test_a_clearance_ends_with_its_arrays_and_the_ground_is_held_anew() -> None:
    """A vehicle broken down in the zone: nobody knows when it will have left."""
    late = HORIZON - 2
    for cycle, kept in ((late - 1, True), (late, False)):
        cars = snapshot(s=[-10.0], v=[0.0], accepted=[7], cycle=cycle, time_s=0.1 * cycle)
        book = offered(accepted=True)
        assert (names(decision.settle(book, cars, GROUND).lapsed) == ["a"]) is not kept
        picture_of(cars, book)
        assert (book.held["a"].clearance == 7) is kept


def concluded(cars: Snapshot, book: Book) -> Floats:
    """The speeds of vehicles that are all cleared already."""
    picture = picture_of(cars, book)
    nobody = Bidders(np.empty(0, dtype=np.int64), (), np.zeros((1, 0)), np.empty(0, dtype=np.int64))
    return decision.conclude(cars, GROUND, book, picture, nobody, None, Parameters(), 1, False).speeds


def test_who_is_behind_its_profile_may_catch_up() -> None:
    """A speed measured too low must not hold it back: every dip would be for good, and its ground be left late."""
    for behind_m, speed in ((0.0, 10.0), (0.3, 10.15), (5.0, 10.3)):
        cars = snapshot(s=[40.0 + behind_m], v=[9.4], accepted=[7])
        assert concluded(cars, offered(accepted=True)) == pytest.approx([speed])


def test_no_planned_speed_passes_the_interlock() -> None:
    cars, book = snapshot(s=[14.0, 100.0], movement=[ACROSS, ACROSS]), Book()
    picture = picture_of(cars, book)
    limits = picture.limits
    who = Bidders(np.array([0, 1]), (2,), np.zeros((1, 2)), np.zeros(2, dtype=np.int64))
    winner = Winner(0, 0.0, np.array([0, 1]), np.array([30.0, 40.0]), np.array([99.0, 99.0]), np.zeros(2))
    made = decision.conclude(cars, GROUND, book, picture, who, winner, Parameters(), 1, False)
    assert made.speeds[0] <= limits.stop[0] or "a" in book.held
    assert (made.speeds <= limits.top).all()
    assert made.order.tolist() == [0, 1]
