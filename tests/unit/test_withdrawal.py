"""Whose clearance is asked back when windows come too near each other, and whose is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import ACROSS, GROUND, OTHER, limits_of, picture_of, snapshot

from gameopt_im.core import interlock
from gameopt_im.core.granting import grant
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.core.windows import HORIZON
from gameopt_im.core.withdrawal import withdraw
from gameopt_wire.messages import STEP_S

PARAMETERS = Parameters()
TIMES = np.arange(HORIZON) * STEP_S
# On ACROSS the area lies from 5 to 9 m past the line, on OTHER from 11 to 15 m; cars are 5 m long.


def held(vehicle: str, movement: int, x: float, v: float = 10.0, **changes: Any) -> Reservation:
    """An accepted clearance at constant speed from x past the line, in the worst case too."""
    values: dict[str, Any] = {
        "vehicle": vehicle, "clearance": 1, "start": 0, "movement": movement, "footprint": 0, "lane": movement,
        "length": 5.0, "b": 4.5, "x": x + v * TIMES, "v": np.full(HORIZON, v), "late_x": x + v * TIMES,
        "late_v": np.full(HORIZON, v), "done": 90, "start_s": 0.0, "expires_s": 0.5, "accepted": True,
    }  # fmt: skip
    return Reservation(**(values | changes))


def book_of(*reservations: Reservation) -> Book:
    book = Book()
    for each in reservations:
        book.add(each)
    return book


def asked(cars: Snapshot, book: Book) -> list[str]:
    """Who is asked in this control cycle."""
    return list(withdraw(cars, GROUND, book, limits_of(cars, book), PARAMETERS.interlock))


def crossing_pair(behind_m: float, first_s: float = 40.0) -> tuple[Snapshot, Book]:
    """a across ACROSS, its rear off the area after 14 m; b across OTHER, so far behind a that it comes later."""
    second_s = first_s + behind_m
    cars = snapshot(s=[first_s, second_s], movement=[ACROSS, OTHER], accepted=[1, 1])
    return cars, book_of(held("a", ACROSS, -first_s), held("b", OTHER, -second_s))


def test_windows_with_half_their_margin_left_stay() -> None:
    cars, book = crossing_pair(3.0 + 0.8)  # b comes 0.08 s after a has gone; half of 0.15 s, or of 1 m at 10 m/s
    assert asked(cars, book) == []


def test_the_later_of_two_that_come_too_near_gives_way() -> None:
    cars, book = crossing_pair(3.0 + 0.6)
    assert asked(cars, book) == ["b"]
    assert book.held["b"].withdrawn
    assert asked(cars, book) == []  # it is asked already


def test_the_earlier_gives_way_where_the_later_cannot_stop() -> None:
    """b, held up on its way, is on its area from 3.5 s on; a would leave it then."""
    cars = snapshot(s=[15.0, 12.0], movement=[OTHER, ACROSS], accepted=[1, 1])
    assert asked(cars, book_of(held("a", OTHER, -15.0), held("b", ACROSS, -12.0, 4.8))) == ["a"]


def test_nobody_is_asked_who_cannot_stop() -> None:
    cars, book = crossing_pair(3.0, first_s=8.0)
    assert asked(cars, book) == []


def test_ground_that_somebody_holds_without_a_clearance_is_kept_clear() -> None:
    cars = snapshot(s=[-6.0, 28.0], movement=[ACROSS, OTHER], accepted=[-1, 1])
    intruder = held("a", ACROSS, 6.0, clearance=0, late_x=6.0 + 2.0 * TIMES)
    assert asked(cars, book_of(intruder, held("b", OTHER, -28.0))) == ["b"]


def test_whoever_follows_it_in_its_lane_gives_way_too() -> None:
    cars, book = crossing_pair(3.0)
    cars = snapshot(s=[40.0, 43.0, 60.0], movement=[ACROSS, OTHER, OTHER], accepted=[1, 1, 1])
    book.add(held("c", OTHER, -60.0))
    assert asked(cars, book) == ["b", "c"]


def test_but_not_one_who_cannot_stop() -> None:
    cars = snapshot(s=[40.0, 43.0, 44.0], v=[10.0, 10.0, 20.0], movement=[ACROSS, OTHER, OTHER], accepted=[1, 1, 1])
    book = book_of(held("a", ACROSS, -40.0), held("b", OTHER, -43.0), held("c", OTHER, -44.0))
    assert asked(cars, book) == ["b"]


def test_nobody_is_cleared_behind_one_that_is_asked() -> None:
    cars, book = snapshot(s=[40.0, 60.0], accepted=[1, -1]), book_of(held("a", ACROSS, -40.0))
    for withdrawn in (False, True):
        book.withdraw("a", withdrawn)
        picture = picture_of(cars, book)
        given = grant(
            cars, GROUND, book, picture.limits, picture.scene, np.array([1]), np.array([0.0, 9.0]),
            np.array([False, True]), PARAMETERS, 2,
        ).given  # fmt: skip
        assert (not given) is withdrawn
        if given:
            book.free("b")


def test_one_that_is_asked_may_stand_at_the_line_at_worst() -> None:
    """It has not been heard since."""
    cars = snapshot(s=[10.0], heard_s=[30.0], age=[2.0], accepted=[1], cycle=20)
    book = book_of(held("a", ACROSS, -30.0))
    for withdrawn, x in ((False, -10.0), (True, -30.0 + 10.0 * 2.0 - 0.5 * 4.5 * 2.0**2)):
        book.withdraw("a", withdrawn)
        phase = interlock.phases(cars, GROUND, book)
        assert interlock.at_worst(cars, GROUND, book, phase, PARAMETERS.exit)[0] == pytest.approx([x])


def test_a_worst_case_is_brought_up_to_date_where_rule_2_cannot_be_kept_any_more() -> None:
    """The follower has slipped into its leader's braking distance: it will come late, and its window must say so."""
    cars = snapshot(s=[30.0, 36.5], v=[4.0, 12.0], accepted=[1, 1])
    book = book_of(held("a", ACROSS, -30.0, 4.0), held("b", ACROSS, -36.5, 12.0))
    picture_of(cars, book)
    assert book.held["b"].late_x[20] < -36.5 + 12.0 * 2.0 - 5.0


def test_whoever_could_not_stop_any_more_keeps_its_clearance_for_good() -> None:
    cars, book = crossing_pair(30.0)
    book.withdraw("a")
    asked(cars, book)
    assert book.held["a"].withdrawn  # it may yet drop it
    cars = snapshot(s=[5.0, 70.0], movement=[ACROSS, OTHER], accepted=[1, 1])
    asked(cars, book)
    assert not book.held["a"].withdrawn


def test_the_speed_sent_is_one_to_stop_by() -> None:
    """Whoever drops its clearance in this step drives by the command."""
    cars, book = crossing_pair(1.0, first_s=12.1)
    picture = picture_of(cars, book)
    assert picture.withdrawn == ("b",)
    free, stop = picture.limits.stop
    assert free > 1e6
    assert stop < 10.0
