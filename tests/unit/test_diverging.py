"""Leaders across diverges: whoever has turned off leads nobody, whoever has not leads all behind it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import snapshot
from plain_nets import build_plain
from shapely.geometry import LineString
from sites import site

from gameopt_im.core import interlock
from gameopt_im.core.conflicts import Ground, ground
from gameopt_im.core.diverging import APART_M, spans
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Snapshot
from gameopt_sumo.network import read_map
from gameopt_wire.intersection import IntersectionMap


@pytest.fixture(scope="module")
def one_lane(tmp_path_factory: pytest.TempPathFactory) -> IntersectionMap:
    folder: Path = tmp_path_factory.mktemp("net")
    return read_map(build_plain("single-lane", folder))


@pytest.fixture(scope="module")
def crossing(one_lane: IntersectionMap) -> Ground:
    return ground(one_lane, "areas", 25.0, turn_speed=True)


def of_lane(intersection: IntersectionMap, lane: int) -> dict[str, int]:
    """The movements of a lane, by intention."""
    found = enumerate(intersection.movements)
    return {movement.intention: index for index, movement in found if movement.lane == lane}


def test_paths_part_where_shapely_says_so(one_lane: IntersectionMap, crossing: Ground) -> None:
    for i, first in enumerate(one_lane.movements):
        for j, second in enumerate(one_lane.movements):
            if i == j or first.lane != second.lane:
                assert crossing.apart[i, j] == np.inf
                continue
            parted_m = float(crossing.apart[i, j])
            line, path = LineString(first.path), LineString(second.path)
            assert 5.0 < parted_m < second.length_m
            assert line.distance(path.interpolate(parted_m)) == pytest.approx(APART_M, abs=0.3)


def queue(one_lane: IntersectionMap, crossing: Ground, *vehicles: tuple[str, float]) -> Snapshot:
    """Cars out of lane 0 with their intentions, so far past the line, standing."""
    turns = of_lane(one_lane, 0)
    cars = snapshot(
        s=[-past for _, past in vehicles], v=np.zeros(len(vehicles)), movement=[turns[name] for name, _ in vehicles]
    )
    return replace(cars, lane=crossing.lane[cars.movement])


def leader_of_last(one_lane: IntersectionMap, crossing: Ground, *vehicles: tuple[str, float]) -> int:
    cars = queue(one_lane, crossing, *vehicles)
    return int(interlock.limits(cars, crossing, Book(), Parameters().exit).leader[-1])


def test_who_has_turned_off_leads_no_more(one_lane: IntersectionMap, crossing: Ground) -> None:
    turns = of_lane(one_lane, 0)
    parted_m = float(crossing.apart[turns["straight"], turns["right"]])
    last = ("straight", -10.0)
    assert leader_of_last(one_lane, crossing, ("right", parted_m + 5.0 - 0.5), last) == 0
    assert leader_of_last(one_lane, crossing, ("right", parted_m + 5.0 + 0.5), last) == -1
    assert leader_of_last(one_lane, crossing, ("straight", 60.0), last) == 0


def test_one_who_is_about_to_turn_off_hides_nobody(one_lane: IntersectionMap, crossing: Ground) -> None:
    """Behind a right turner stands a left turner's tail: the follower has to mind both."""
    cars = queue(one_lane, crossing, ("left", 12.0), ("right", 4.0), ("straight", -10.0))
    limits = interlock.limits(cars, crossing, Book(), Parameters().exit)
    assert sorted(limits.leaders[2].tolist()) == [-1, 0, 1]
    assert limits.leader[2] == 1


def test_who_turns_back_keeps_its_lane_for_longer() -> None:
    """A truck's front is back beside its own lane before its tail has left it; a car's hardly is."""
    length, path_m = np.array([10.0, 4.0, 10.0]), np.array([4.7, 4.7, 4.7])
    found = spans(length, path_m, np.array([True, True, False]), np.zeros(3))
    assert found.tolist() == [pytest.approx(15.3), 4.0, 10.0]


def test_and_those_behind_wait_further_back(tmp_path: Path) -> None:
    """In SUMO's square, whose U-turns are 5 m long, a truck once swept the front of the car that waited behind it."""
    place = site("square", tmp_path)
    found = read_map(place.net, place.junction)
    square = ground(found, "areas", 25.0, turn_speed=True)
    turns = of_lane(found, 0)
    follow = []
    for leader in ("turnaround", "left"):
        cars = snapshot(s=[-9.8, 12.0], v=[4.0, 4.0], length=[10.0, 5.0], movement=[turns[leader], turns["right"]])
        cars = replace(cars, lane=square.lane[cars.movement])
        follow.append(float(interlock.limits(cars, square, Book(), Parameters().exit).follow[1]))
    assert follow[0] < follow[1] - 1.0


def test_a_body_too_long_for_the_turn_is_longer_to_those_behind(tmp_path: Path) -> None:
    """Its chord is shorter than itself, and its tail swings out over the lane that it came from."""
    found = read_map(build_plain("single-lane", tmp_path), articulated=True)
    long = ground(found, "areas", 25.0, turn_speed=True)
    turns = of_lane(found, 0)
    assert long.tail[:, :-1].max() == 0.0  # up to a bus it is no more than the standing gap
    assert long.tail[turns["straight"], -1] == 0.0
    assert 2.0 < long.tail[turns["right"], -1] < 3.0
    follow = []
    for leader in ("straight", "right"):
        cars = snapshot(s=[-8.0, 14.0], v=[4.0, 4.0], length=[18.75, 5.0], movement=[turns[leader], turns["straight"]])
        cars = replace(cars, lane=long.lane[cars.movement], footprint=np.array([4, 0]))
        follow.append(float(interlock.limits(cars, long, Book(), Parameters().exit).follow[1]))
    assert follow[1] < follow[0] - 1.0
