"""In the worst case a follower stays behind where its leader is in its own, on a clearance and on the exit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import ACROSS, GROUND, picture_of, snapshot

from gameopt_im.core.leading import B, V, X, limit, nobody, room_behind, ways_of
from gameopt_im.core.profiles import STOP_PLAY_M
from gameopt_im.core.reservations import LOOSE, Book, Reservation
from gameopt_im.core.snapshot import Floats
from gameopt_im.core.windows import HORIZON
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

LENGTH_M, SPEED_MPS = 5.0, 15.0
CLEAR_X = float(GROUND.clear[ACROSS]) + LENGTH_M
"""Here the front of a car is when its rear stands clear."""


def stays_behind(follower: Floats, leader: Floats) -> bool:
    return bool((follower <= leader - LENGTH_M - motion.REAR_GAP_M + 2.0 * STOP_PLAY_M).all())


def cleared(vehicle: str, x0: float) -> Reservation:
    x = x0 + SPEED_MPS * STEP_S * np.arange(HORIZON)
    v = np.full(HORIZON, SPEED_MPS)
    return Reservation(
        vehicle=vehicle, clearance=1, start=0, movement=ACROSS, footprint=0, lane=ACROSS, length=LENGTH_M, b=4.5,
        x=x, v=v, late_x=x.copy(), late_v=v.copy(), done=HORIZON - 1, start_s=0.0, expires_s=0.5, accepted=True,
    )  # fmt: skip


def test_on_a_clearance() -> None:
    """Both would drive on for ever; in the worst case the first has to stop where its sight ends."""
    book = Book()
    for vehicle, x0 in (("a", 5.0), ("b", -35.0)):
        book.add(cleared(vehicle, x0))
    picture_of(snapshot(s=[-5.0, 35.0], v=[SPEED_MPS] * 2, accepted=[1, 1], ids=("a", "b")), book)
    first, second = (book.held[vehicle].late_x for vehicle in "ab")
    assert first[-1] < first[0] + 0.9 * SPEED_MPS * STEP_S * HORIZON  # it has stopped
    assert stays_behind(second, first)


def test_on_the_exit() -> None:
    book = Book()
    made = picture_of(snapshot(s=[-CLEAR_X - 60.0, -CLEAR_X - 20.0], v=[SPEED_MPS] * 2, ids=("a", "b")), book)
    assert made.scene.exiting.all()
    first, second = book.rows.late_x[made.scene.way]
    assert first[-1] < first[0] + 0.9 * SPEED_MPS * STEP_S * HORIZON
    assert stays_behind(second, first)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("start", [0, 10])
def test_the_room_from_some_time_ago_is_the_room_from_now_with_what_went_before(late: bool, start: int) -> None:
    """One leader on a clearance, one on a way that begins just now (10), one of whom only place and speed are known."""
    book = Book()
    book.add(replace(cleared("a", 5.0), start=start))
    ahead = nobody(2)
    ahead.row[0] = ahead.late_row[0] = book.row["a"]
    ahead.number[1, X], ahead.number[1, V], ahead.number[1, B] = 30.0, SPEED_MPS, 4.5
    ways = ways_of(book.rows)
    now, ago = room_behind(ahead, late, 10, 0, ways), room_behind(ahead, late, 10, 3, ways)
    for m in range(2):
        for k in range(50):
            assert limit(m, k + 3, ago) == pytest.approx(limit(m, k, now))
        assert limit(m, 0, ago)[0] == pytest.approx(limit(m, 0, now)[0] - 3.0 * SPEED_MPS * STEP_S)


def test_exit_ways_are_nobodys_reservations() -> None:
    """They are driven in rows of the book; who has which is the scene's to know, not the book's."""
    book, cars = Book(), snapshot(s=[-CLEAR_X - 60.0, -CLEAR_X - 20.0], v=[SPEED_MPS] * 2)
    assert (picture_of(cars, book).scene.way >= 0).all()
    assert (book.rows_of(cars.ids) == LOOSE).all()
