"""The paper's table, the ground of a map, and who shares an auction."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from builders import CAR, CONFLICT, GROUPS, TRUCK, area, four_arm, movement, window

from gameopt_im.core.conflicts import (
    OUTSIDE,
    PAPER_GROUPS,
    ground,
    groups,
    no_conflict_groups,
)
from gameopt_wire.messages import Geometry


def test_the_papers_table_is_symmetric_and_leaves_out_right_turns() -> None:
    assert sorted(PAPER_GROUPS) == sorted(name for name in GROUPS if not name.endswith("-0"))
    for name, friends in PAPER_GROUPS.items():
        assert len(friends) == 3
        assert name not in friends
        assert all(name in PAPER_GROUPS[friend] for friend in friends)


def test_the_map_gives_the_papers_table_back() -> None:
    assert no_conflict_groups(four_arm()) == PAPER_GROUPS


@pytest.mark.parametrize("geometry", ["areas", "box"])
def test_conflicts_are_those_of_the_map_in_either_geometry(geometry: Geometry) -> None:
    made = ground(four_arm(), geometry, 25.0, turn_speed=True)
    np.testing.assert_array_equal(made.conflict, CONFLICT)
    np.testing.assert_array_equal(made.conflict, made.conflict.T)
    np.testing.assert_array_equal(np.flatnonzero(made.free), [0, 3, 6, 9])


def test_windows_are_read_from_the_side_of_the_first_movement() -> None:
    made = ground(four_arm(), "areas", 25.0, turn_speed=True)
    assert made.windows.shape == (12, 2, 12, 2, 2)
    np.testing.assert_array_equal(made.windows[1, 0, 7, 0], [5.0, 9.0])
    np.testing.assert_array_equal(made.windows[7, 0, 1, 0], [11.0, 15.0])
    np.testing.assert_array_equal(made.windows[1, 1, 7, 0], [4.0, 11.0])
    assert np.isnan(made.windows[~made.conflict[:, None, :, None].repeat(2, 1).repeat(2, 3)]).all()


def test_each_side_keeps_its_own_footprint_first() -> None:
    lopsided = [[None, (1.0, 2.0)], [(3.0, 4.0), None]]
    crossing = area(1, 7, a_windows_m=lopsided, b_windows_m=[[None, (5.0, 6.0)], [(7.0, 8.0), None]])
    made = ground(four_arm(areas=[crossing]), "areas", 25.0, turn_speed=True)
    assert made.windows[1, 0, 7, 1].tolist() == [1.0, 2.0]
    assert made.windows[1, 1, 7, 0].tolist() == [3.0, 4.0]
    assert made.windows[7, 0, 1, 1].tolist() == [5.0, 6.0]
    assert made.windows[7, 1, 1, 0].tolist() == [7.0, 8.0]
    assert np.isnan(made.windows[1, 0, 7, 0]).all()


def test_the_box_is_the_whole_zone_for_every_conflicting_pair() -> None:
    far = area(1, 7, a_windows_m=window(30.0), b_windows_m=[[None, None], [None, (2.0, 3.0)]])
    made = ground(four_arm(areas=[far, area(1, 8)]), "box", 25.0, turn_speed=True)
    np.testing.assert_array_equal(made.windows[1, 0, 7, 0], [0.0, 36.0])  # a car's last exit beside a truck
    np.testing.assert_array_equal(made.windows[1, 0, 8, 1], [0.0, 36.0])
    np.testing.assert_array_equal(made.windows[1, 1, 7, 0], [0.0, 38.0])
    np.testing.assert_array_equal(made.windows[7, 0, 1, 0], [0.0, 25.0])
    assert np.isnan(made.windows[1, 0, 4, 0]).all()
    np.testing.assert_array_equal(made.clear, np.full(12, 25.0))
    assert ground(four_arm(), "areas", 25.0, turn_speed=True).clear.tolist() == [22.0] * 12


def test_the_arrays_of_movements_lanes_and_footprints() -> None:
    made = ground(four_arm(), "areas", 25.0, turn_speed=True)
    assert made.lane.tolist() == list(range(12))
    assert made.exit_lane.tolist() == list(range(12))
    assert made.length[3] == 23.0
    assert made.turn_mps[:3].tolist() == [8.0, np.inf, 10.0]
    assert made.exit_mps[0] == 20.0
    assert made.exit_length[0] == 200.0
    assert made.limit_mps[:3].tolist() == [20.0, 19.0, 18.0]
    assert np.isinf(ground(four_arm(), "areas", 25.0, turn_speed=False).turn_mps).all()


def test_movements_to_one_exit_lane_share_its_index() -> None:
    movements = [movement(0, exit_lane="x"), movement(1, exit_lane="y"), movement(2, exit_lane="x")]
    made = ground(four_arm(movements=movements, areas=[]), "areas", 25.0, turn_speed=True)
    assert made.exit_lane.tolist() == [0, 1, 0]


def test_a_right_turn_that_merges_is_not_free() -> None:
    made = ground(four_arm(areas=[area(0, 7, merge=True)]), "areas", 25.0, turn_speed=True)
    assert not made.free[0]
    assert made.conflict[0, 7]


def test_vehicles_of_one_lane_follow_each_other_and_do_not_conflict() -> None:
    movements = [movement(0, lane=1), movement(1, lane=1)]
    made = ground(four_arm(movements=movements, areas=[area(0, 1)]), "areas", 25.0, turn_speed=True)
    assert not made.conflict.any()


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"movements": [movement(0, lane=12)], "areas": []}, "movement '0-0': lane 12 of 12"),
        ({"areas": [area(1, 12)]}, "conflict area 1-12: wants a < b < 12"),
        ({"areas": [area(7, 1)]}, "conflict area 7-1: wants a < b < 12"),
        ({"areas": [area(1, 7, b_windows_m=[[None]])]}, "conflict area 1-7: wants 2 x 2 windows"),
    ],
)
def test_a_map_that_points_at_nothing_is_refused(changes: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        ground(four_arm(**changes), "areas", 25.0, turn_speed=True)


@pytest.mark.parametrize(
    ("length_m", "width_m", "index"),
    [(4.0, 1.8, 0), (5.0, 2.0, 0), (5.1, 2.0, 1), (4.0, 2.4, 1), (12.0, 2.5, 1), (18.0, 2.6, 1)],
)
@pytest.mark.parametrize("swapped", [False, True])
def test_a_vehicle_gets_the_smallest_footprint_that_covers_it(
    length_m: float, width_m: float, index: int, swapped: bool
) -> None:
    footprints = [TRUCK, CAR] if swapped else [CAR, TRUCK]
    made = four_arm(footprints=footprints, areas=[])
    assert made.footprint_of(length_m, width_m) == (1 - index if swapped else index)


def test_groups_are_the_components_among_those_present() -> None:
    def of(*names: str) -> list[int]:
        return groups(np.array([GROUPS.index(name) for name in names], dtype=np.int64), CONFLICT).tolist()

    assert of("0-1", "0-2") == [0, 1]  # they do not conflict, and nobody links them
    assert of("0-1", "0-2", "2-1") == [0, 0, 0]  # 2-1 conflicts with both
    assert of("0-2", "0-1", "0-2", "0-0") == [1, 0, 1, OUTSIDE]
    assert of("1-0", "2-0") == [OUTSIDE, OUTSIDE]
    assert of() == []


def test_groups_match_a_search_vehicle_by_vehicle() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        present = rng.integers(0, 12, rng.integers(1, 7))
        label = groups(present, CONFLICT)
        linked = CONFLICT[np.ix_(present, present)] | (present[:, None] == present[None, :])
        for _ in present:
            linked = linked @ linked
        for i, j in itertools.combinations(range(len(present)), 2):
            inside = label[i] != OUTSIDE and label[j] != OUTSIDE
            assert (inside and label[i] == label[j]) == (inside and linked[i, j])
