"""Post-encroachment time against crossings whose gap is known."""

from __future__ import annotations

import pytest

from gameopt_sumo.encroachment import Encroachment
from gameopt_sumo.observation import Pose

SQUARE = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)]


def eastbound(time_s: float, front_at_0_s: float) -> Pose:
    return Pose("east", (time_s - front_at_0_s) * 10.0, 0.0, 90.0, 5.0, 2.0, 10.0, "w_0")


def northbound(time_s: float, front_at_0_s: float) -> Pose:
    return Pose("north", 0.0, (time_s - front_at_0_s) * 10.0, 0.0, 5.0, 2.0, 10.0, "s_0")


def least(second_s: float, lanes: dict[str, int]) -> float | None:
    field = Encroachment(SQUARE)
    for step in range(120):
        time_s = round(step * 0.1, 1)
        field.step(time_s, [eastbound(time_s, 3.0), northbound(time_s, 3.0 + second_s)], lanes)
    return field.least_s


@pytest.mark.parametrize("second_s", [1.2, 1.5, 2.37])
def test_crossing_paths(second_s: float) -> None:
    """The east-bound rear leaves x = 1 at 3.6 s, the north-bound front reaches y = -1 at second - 0.1 s."""
    found = least(second_s, {"east": 0, "north": 1})
    assert found == pytest.approx(second_s - 0.1 - 0.6, abs=0.1)


def test_bodies_on_the_same_ground_have_none_left() -> None:
    assert least(0.3, {"east": 0, "north": 1}) == 0.0


def test_followers_out_of_one_lane_do_not_count() -> None:
    assert least(1.5, {"east": 0, "north": 0}) is None


def test_a_lone_vehicle_has_none() -> None:
    field = Encroachment(SQUARE)
    for step in range(60):
        field.step(step * 0.1, [eastbound(step * 0.1, 3.0)], {"east": 0})
    assert field.least_s is None
