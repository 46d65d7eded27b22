"""The geometric check finds planted overlaps, also between steps, and none where there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import Polygon, box

from gameopt_sumo.collisions import OverlapCheck


@dataclass(frozen=True)
class Parked:
    vehicle: str
    x_m: float
    y_m: float
    angle_deg: float = 90.0
    length_m: float = 5.0
    width_m: float = 1.8


def moving(vehicle: str, x_m: float, y_m: float, angle_deg: float, mps: float, steps: int) -> list[Parked]:
    """One pose per step of 0.1 s, straight on."""
    dx, dy = math.sin(math.radians(angle_deg)) * mps / 10, math.cos(math.radians(angle_deg)) * mps / 10
    return [Parked(vehicle, x_m + dx * k, y_m + dy * k, angle_deg) for k in range(steps)]


def run(check: OverlapCheck, *tracks: list[Parked]) -> list[tuple[str, str]]:
    for poses in zip(*tracks, strict=True):
        check.step(poses)
    return list(check.pairs)


def test_a_planted_overlap_is_found_and_counted_once() -> None:
    tracks = moving("a", 0.0, 0.0, 90.0, 20.0, 30), moving("b", 30.0, -30.0, 0.0, 20.0, 30)
    assert run(OverlapCheck(), *tracks) == [("a", "b")]


def test_vehicles_that_pass_one_after_the_other_do_not_overlap() -> None:
    tracks = moving("a", 0.0, 0.0, 90.0, 20.0, 40), moving("b", 30.0, -40.0, 0.0, 20.0, 40)
    assert run(OverlapCheck(), *tracks) == []


def test_neighbouring_lanes_and_a_queue_do_not_overlap() -> None:
    lanes = [moving(f"l{i}", 0.0, 3.2 * i, 90.0, 20.0, 20) for i in range(3)]
    queue = [moving(f"q{i}", -5.01 * i, 20.0, 90.0, 5.0, 20) for i in range(3)]
    assert run(OverlapCheck(), *lanes, *queue) == []


def test_an_overlap_only_between_steps_is_found() -> None:
    """Two short bodies cross each other's way within one step; at both ends of it they are apart."""
    before = [Parked("a", 0.0, 0.0, 90.0, 1.0, 1.0), Parked("b", 1.5, -1.0, 0.0, 1.0, 1.0)]
    after = [Parked("a", 4.0, 0.0, 90.0, 1.0, 1.0), Parked("b", 1.5, 3.0, 0.0, 1.0, 1.0)]
    for poses in (before, after):
        check = OverlapCheck()
        check.step(poses)
        check.step(poses)
        assert not check.pairs
    check = OverlapCheck()
    assert check.step(before) == []
    assert check.step(after) == [("a", "b")]


def test_inflation_finds_a_near_miss() -> None:
    tracks = moving("a", 0.0, 0.0, 90.0, 10.0, 5), moving("b", 0.0, 2.2, 90.0, 10.0, 5)
    assert run(OverlapCheck(), *tracks) == []
    assert run(OverlapCheck(inflate_m=0.19), *tracks) == []
    assert run(OverlapCheck(inflate_m=0.21), *tracks) == [("a", "b")]


def test_a_vehicle_put_elsewhere_did_not_drive_through_the_others() -> None:
    check = OverlapCheck()
    check.step([Parked("a", 0.0, 0.0), Parked("b", 30.0, 0.0)])
    assert check.step([Parked("a", 60.0, 0.0), Parked("b", 30.0, 0.0)]) == []


def test_the_angle_is_clockwise_from_north_and_the_position_is_the_front() -> None:
    """A truck heading east with its front at the origin covers the ground to the west of it."""
    truck = Parked("truck", 0.0, 0.0, 90.0, 12.0, 2.5)
    assert OverlapCheck().step([truck, Parked("west", -11.0, 0.0, 0.0, 2.0, 1.0)]) == [("truck", "west")]
    assert OverlapCheck().step([truck, Parked("east", 1.0, 0.0, 0.0, 2.0, 1.0)]) == []


def shape(pose: Parked) -> Polygon:
    flat = box(-pose.width_m / 2, -pose.length_m, pose.width_m / 2, 0.0)
    turned = affinity.rotate(flat, -pose.angle_deg, origin=(0.0, 0.0))
    placed = affinity.translate(turned, pose.x_m, pose.y_m)
    assert isinstance(placed, Polygon)
    return placed


@pytest.mark.parametrize("seed", range(5))
def test_still_scenes_agree_with_shapely_pair_by_pair(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = [
        Parked(
            f"v{i:02d}",
            *random.uniform(-30.0, 30.0, 2),
            random.uniform(0.0, 360.0),
            random.uniform(4.0, 12.0),
        )
        for i in range(30)
    ]
    check = OverlapCheck()
    check.step(poses)
    expected = {
        (a.vehicle, b.vehicle) for a, b in combinations(poses, 2) if shape(a).intersection(shape(b)).area > 1e-9
    }
    assert set(check.pairs) == expected
    assert expected
