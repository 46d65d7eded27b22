"""Clearances: windows, worst cases and reservations with numbers small enough to work out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from builders import ACROSS, GROUND, OTHER, behind, braking, picture_of, snapshot

from gameopt_im.core import interlock
from gameopt_im.core.granting import NO_SLOT, Grants, grant
from gameopt_im.core.interlock import INTRUDING, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.profiles import STOP_PLAY_M, drive, held_back
from gameopt_im.core.reservations import Book, clash
from gameopt_im.core.snapshot import Floats, Snapshot
from gameopt_im.core.windows import HORIZON, overlap, time_at
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

PARAMETERS = Parameters()
TIMES = np.arange(HORIZON) * STEP_S


def granted(cars: Snapshot, book: Book, slots: list[float], first: int = 1) -> Grants:
    """All ask, in the order of the snapshot."""
    everyone = np.arange(len(cars))
    asking = np.ones(len(cars), dtype=np.bool_)
    picture = picture_of(cars, book)
    return grant(
        cars, GROUND, book, picture.limits, picture.scene, everyone, np.array(slots), asking, PARAMETERS, first
    )


def window(begin: float, end: float, speed_in: float = 10.0, speed_out: float = 10.0) -> tuple[float, ...]:
    return begin, end, speed_in, speed_out


def test_windows_apart_by_the_margin_do_not_overlap() -> None:
    assert overlap(window(4.2, 5.0), window(3.0, 4.0), 0.15, 1.0) == 0.0
    assert overlap(window(1.0, 2.0), window(2.2, 3.0), 0.15, 1.0) == 0.0
    assert overlap(window(3.2, 3.8), window(-1.0, -1.0), 0.15, 1.0) == 0.0  # it has left


def test_the_margin_in_seconds_counts_before_and_after() -> None:
    assert overlap(window(4.1, 5.0), window(3.0, 4.0), 0.15, 0.0) == pytest.approx(0.05)
    assert overlap(window(1.0, 2.0), window(2.1, 3.0), 0.15, 0.0) == pytest.approx(3.15 - 1.0)


def test_the_margin_in_metres_counts_at_the_slower_speed() -> None:
    assert overlap(window(4.1, 5.0, speed_in=4.0), window(3.0, 4.0), 0.0, 1.0) == pytest.approx(0.15)
    assert overlap(window(4.1, 5.0), window(3.0, 4.0, speed_out=4.0), 0.0, 1.0) == pytest.approx(0.15)
    assert overlap(window(1.0, 2.0), window(2.1, 3.0, speed_in=2.0), 0.0, 1.0) > 0.0
    assert overlap(window(1.0, 2.0, speed_out=2.0), window(2.1, 3.0), 0.0, 1.0) > 0.0


def clash_behind(x0: float, movement: int, margin_s: float, margin_m: float) -> float:
    """A car from x0 against one from -50 m across, both at 10 m/s: that one is on the area from 5.5 to 6.4 s."""
    held, mine = (-50.0 + 10.0 * TIMES)[None], x0 + 10.0 * TIMES
    one = np.array([ACROSS])
    return float(
        clash(
            mine, mine, 5.0, movement, 0, held, held, np.array([0]), one, np.array([0]), np.array([5.0]),
            GROUND.windows, margin_s, margin_m,
        )
    )  # fmt: skip


def test_a_profile_across_a_reservation_comes_later_by_the_overlap() -> None:
    assert clash_behind(-40.0, OTHER, 0.15, 1.0) == pytest.approx(6.4 + 0.15 - 5.1)
    assert clash_behind(-53.0, OTHER, 0.15, 0.0) == pytest.approx(0.15)
    assert clash_behind(-53.0, OTHER, 0.0, 3.0) == pytest.approx(0.3)
    assert clash_behind(-60.0, OTHER, 0.15, 1.0) == 0.0
    assert clash_behind(-40.0, 0, 0.15, 1.0) == 0.0  # a right turn that meets nobody


def test_who_would_clash_is_aimed_later() -> None:
    cars, book = snapshot(s=[50.0, 50.0], movement=[ACROSS, OTHER]), Book()
    made = granted(cars, book, [4.5, 4.5])
    assert [each.vehicle for each in made.given] == ["a", "b"]
    assert [each.clearance for each in made.given] == [1, 2]
    first, second = made.given
    rear_out = time_at(first.late_x, 0, 9.0 + 5.0)
    assert time_at(second.x, 0, 11.0) >= rear_out + PARAMETERS.interlock.margin_s
    assert time_at(second.x, 0, 0.0) > time_at(first.x, 0, 0.0)


def test_who_would_clash_without_a_slot_is_refused() -> None:
    cars, book = snapshot(s=[50.0, 50.0], movement=[ACROSS, OTHER]), Book()
    made = granted(cars, book, [NO_SLOT, NO_SLOT])
    assert [each.vehicle for each in made.given] == ["a"]
    assert made.refused == 1
    assert list(book.held) == ["a"]


def test_a_follower_is_cleared_only_after_its_leader_has_accepted() -> None:
    cars, book = snapshot(s=[40.0, 60.0]), Book()
    assert [each.vehicle for each in granted(cars, book, [4.0, 7.0]).given] == ["a"]
    assert granted(cars, book, [4.0, 7.0], first=2).given == ()
    book.accept("a")
    assert [each.vehicle for each in granted(cars, book, [4.0, 7.0], first=2).given] == ["b"]


def test_a_follower_reserves_for_its_leaders_worst_case() -> None:
    cars, book = snapshot(s=[40.0, 60.0]), Book()
    granted(cars, book, [4.0, 7.0])
    book.accept("a")
    granted(cars, book, [4.0, 7.0], first=2)
    room = book.held["a"].late_x - 5.0 - motion.REAR_GAP_M
    assert (book.held["b"].late_x <= room + STOP_PLAY_M).all()


def test_an_unbroken_platoon_does_not_stop_for_the_end_of_profiles() -> None:
    """Each profile ends before its follower's: nobody takes that end for a vehicle that stands."""
    book, last = Book(), ""
    for n in range(12):
        cycle, name = 12 * n, f"car {n}"
        ahead = book.held.get(last)
        x, v = (0.0, 0.0) if ahead is None else (ahead.x[12], ahead.v[12])
        ids, s = ((name,), [60.0]) if ahead is None else ((last, name), [-x, 60.0])
        speeds = [15.0] if ahead is None else [v, 15.0]
        accepted = [-1] if ahead is None else [ahead.clearance, -1]
        cars = snapshot(s=s, v=speeds, ids=ids, accepted=accepted, cycle=cycle, time_s=cycle * STEP_S)
        made = granted(cars, book, [3.5] * len(ids), first=n + 1).given
        assert [each.vehicle for each in made] == [name]
        assert made[0].v[-1] > 15.0
        book.accept(name)
        if ahead is not None:
            book.free(last)
        last = name


def test_a_silent_vehicle_is_not_cleared() -> None:
    assert granted(snapshot(s=[40.0], silent=[True]), Book(), [4.0]).given == ()


def held(room: Floats, lead_v: Floats) -> tuple[int, Floats]:
    """The worst case of a car that wants 10 m/s from x = 0, its rear clear at 15 m."""
    late_x, late_v = np.empty(HORIZON), np.empty(HORIZON)
    done = held_back(
        0.0, 10.0, np.full(HORIZON, 10.0), 0, (5.0, 2.6, 4.5), 15.0, (0.0, 10.0, 1e6),
        behind(room, lead_v), late_x, late_v,
    )  # fmt: skip
    return done, late_x


def test_the_worst_case_is_slower_behind_a_braking_leader() -> None:
    free_done, free = held(np.full(HORIZON, NEVER), np.zeros(HORIZON))
    np.testing.assert_allclose(free, 10.0 * TIMES)
    lead_x, lead_v = braking(22.0, 10.0, 4.5)
    room = lead_x - 7.0
    done, late = held(room, lead_v)
    assert done > free_done > 0
    assert (late <= free + 1e-9).all()
    assert late[-1] < free[-1] - 100.0
    assert (late <= room + STOP_PLAY_M).all()


def drive_behind(room_m: float) -> int:
    """A car at 15 m/s, `room_m` behind one that stands for 3 s and is then gone."""
    room = np.where(TIMES < 3.0, room_m, NEVER)
    body, way = (5.0, 2.6, 4.5, 15.0, 15.0), (NEVER, 21.0, 22.0, 15.0, 1.0)
    x, v = np.empty(HORIZON), np.empty(HORIZON)
    leader = behind(room, np.zeros(HORIZON))
    done = drive(0.0, 15.0, NO_SLOT, body, way, Manner((1.0, 3.4), 0.5, 1.0), leader, x, v)
    if done >= 0:
        assert x[int(3.0 / STEP_S) - 1] <= room_m + STOP_PLAY_M
    return int(done)


def test_a_drive_that_cannot_keep_rule_2_is_refused() -> None:
    assert drive_behind(15.0**2 / 9.0 + 1.0) > 0
    assert drive_behind(15.0**2 / 9.0 - 1.0) == -1


def test_who_had_to_creep_is_not_taken_to_creep_on() -> None:
    """Each would creep behind the one before it: five cars in a row, the first held up for 8 s."""
    room, lead_v = np.where(TIMES < 8.0, 2.0, NEVER), np.zeros(HORIZON)
    body, way = (5.0, 2.6, 4.5, 15.0, 15.0), (NEVER, 21.0, 22.0, 15.0, 1.0)
    for place in range(5):
        x, v = np.empty(HORIZON), np.empty(HORIZON)
        done = drive(-9.0 * place, 1.0, NO_SLOT, body, way, Manner((1.0, 3.4), 0.5, 1.0), behind(room, lead_v), x, v)
        assert 0 < done < 250
        assert v[done:].min() > 5.0
        assert v[-1] == 15.0
        room, lead_v = x - body[0] - motion.REAR_GAP_M, v


@pytest.mark.parametrize(("nearer", "phase"), [(0.0, UNCLEARED), (0.1, INTRUDING)])
def test_rule_1s_curve_parts_the_uncleared_from_the_intruding(nearer: float, phase: int) -> None:
    on_curve = motion.STOP_OFFSET_M + 10.0**2 / 9.0
    cars = snapshot(s=[on_curve - nearer])
    assert interlock.phases(cars, GROUND, Book()).tolist() == [phase]


def test_the_interlock_bounds_every_speed() -> None:
    values = np.random.default_rng(2).uniform(2.0, 20.0, (6, 200))
    stop, follow, turn, top, floor, planned = values
    floor = floor - 8.0
    none = np.full(200, -1)
    made = interlock.bounded(planned, Limits(none, none, none[:, None], none, none < 0, stop, follow, turn, top, floor))
    for limit in (planned, stop, follow, turn, top):
        assert (made <= np.maximum(limit, floor)).all()
        assert (made == limit).any()  # each is met: none can be left out
    assert (made >= floor).all()
    assert (made == floor).any()


@pytest.mark.parametrize(
    ("rear_m", "speed", "fits"), [(12.0, 0.0, False), (12.0, 8.0, False), (12.0, 20.0, True), (60.0, 0.0, True)]
)
def test_nobody_is_cleared_into_a_queue_of_strangers(rear_m: float, speed: float, fits: bool) -> None:
    """The area ends 9 m past the line: there has to be room beyond it even if the stranger brakes fully from now."""
    cars = snapshot(s=[40.0], stranger_x=[rear_m], stranger_v=[speed], stranger_b=[4.5])
    assert bool(granted(cars, Book(), [4.0]).given) == fits


def test_nor_behind_an_exiting_vehicle_that_has_one_ahead() -> None:
    """The first stands clear of the zone, behind a stranger that leaves it no room to go on."""
    ahead = {"stranger_v": [0.0, 0.0], "stranger_b": [4.5, 4.5]}
    through = -(GROUND.length[ACROSS] + 8.0)
    for rear_m, fits in ((-through + 3.0, False), (NEVER, True)):
        cars = snapshot(s=[through, 45.0], v=[5.0, 10.0], stranger_x=[rear_m, NEVER], **ahead)
        assert bool(granted(cars, Book(), [NO_SLOT, 4.5]).given) == fits
