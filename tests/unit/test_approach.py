"""The approach law: at the line at the slot, as fast as there is room for, and no faster than it is worth."""

from __future__ import annotations

import pytest

from gameopt_im.core.kinematics import Manner, approach, approach_speed, earliest_arrival
from gameopt_wire import motion

A, B, TOP = 2.0, 4.5, 20.0
MANNER = Manner(decels=(1.0, 1.5, 2.25, 3.4), slowest=0.5, line_share=0.9)
DT = 0.02


def driven(s: float, v: float, slot: float, line: float = TOP, manner: Manner = MANNER) -> tuple[float, float]:
    """(time, speed) at the stop line of a car that drives its plan step by step."""
    plan = approach(s, v, slot, A, B, TOP, line, manner)
    turn_b = min(motion.TURN_DECEL_MPS2, B)
    time = 0.0
    while s > 0.0:
        u = approach_speed(s, v, slot - time, plan[0], plan[1], A, TOP, line, turn_b, DT)
        u = max(0.0, min(u, motion.turn_speed(s, v, B, DT, line)))
        s -= 0.5 * DT * (v + u)
        v, time = u, time + DT
        assert time < 60.0
    return time, v


@pytest.mark.parametrize("slot", [8.0, 9.0, 11.0, 14.0, 20.0])
@pytest.mark.parametrize("line", [TOP, 11.0, 8.0])
def test_a_car_is_at_the_line_at_its_slot(slot: float, line: float) -> None:
    first, _ = earliest_arrival(150.0, TOP, A, TOP, line, motion.TURN_DECEL_MPS2)
    time, speed = driven(150.0, TOP, max(slot, first), line)
    assert time == pytest.approx(max(slot, first), abs=0.15)
    assert speed <= line + 0.1


def test_who_is_in_time_keeps_its_speed() -> None:
    assert driven(150.0, TOP, 7.5)[1] == pytest.approx(TOP)


@pytest.mark.parametrize("slot", [10.0, 12.0, 16.0])
def test_who_has_to_wait_aims_at_its_share_of_the_top_speed(slot: float) -> None:
    plan = approach(150.0, TOP, slot, A, B, TOP, TOP, MANNER)
    assert plan[2] == pytest.approx(0.9 * TOP)
    assert plan[4] == pytest.approx(slot, abs=0.02)
    assert approach(150.0, TOP, slot, A, B, TOP, TOP, MANNER._replace(line_share=1.0))[2] > 0.95 * TOP


def test_a_short_wait_costs_no_more_speed_than_it_has_to() -> None:
    """8 s for 150 m is 18.75 m/s on average: no need to brake below it and accelerate again."""
    h, _, line, _, time = approach(150.0, TOP, 8.0, A, B, TOP, TOP, MANNER)
    assert line == h > 0.9 * TOP
    assert time == pytest.approx(8.0, abs=0.02)


def test_a_turn_is_taken_at_its_own_speed() -> None:
    assert approach(150.0, TOP, 16.0, A, B, TOP, 11.0, MANNER)[2] == pytest.approx(11.0)


def test_without_the_room_it_gets_as_fast_as_it_can() -> None:
    plan = approach(30.0, 5.0, 9.0, A, B, TOP, TOP, MANNER)
    assert 8.0 < plan[2] < 0.9 * TOP
