"""Leaders: in the lane, across the stop line, where lanes split and where they join."""

from __future__ import annotations

from pathlib import Path

import pytest

from gameopt_sumo.network import read_map
from gameopt_sumo.radar import Body, Radar
from gameopt_sumo.scenarios import write_net
from gameopt_wire.intersection import IntersectionMap


@pytest.fixture(scope="module")
def one_lane(tmp_path_factory: pytest.TempPathFactory) -> IntersectionMap:
    net: Path = tmp_path_factory.mktemp("net") / "one.net.xml"
    write_net(1, net)
    return read_map(net)


def index(intersection_map: IntersectionMap, movement: str) -> int:
    return [m.id for m in intersection_map.movements].index(movement)


def on_path(intersection_map: IntersectionMap, vehicle: str, movement: str, past_line_m: float) -> Body:
    number = index(intersection_map, movement)
    found = intersection_map.movements[number]
    exit_m = past_line_m - found.length_m
    return Body(
        vehicle,
        number,
        found.lane,
        past_line_m,
        5.0,
        found.exit_lane if exit_m >= 0.0 else None,
        max(0.0, exit_m),
    )


def test_in_the_lane_and_across_the_stop_line(one_lane: IntersectionMap) -> None:
    bodies = [on_path(one_lane, f"v{-x}", "0-1", x) for x in (-100, -60, -2, 8)]
    assert Radar(one_lane).leaders(bodies) == {
        "v100": ("v60", 35.0), "v60": ("v2", 53.0), "v2": ("v-8", 5.0)
    }  # fmt: skip


def test_a_leader_that_turns_off_counts_until_it_is_clear(one_lane: IntersectionMap) -> None:
    straight = on_path(one_lane, "straight", "0-1", -20.0)
    assert Radar(one_lane).leaders([straight, on_path(one_lane, "right", "0-0", 4.0)]) == {
        "straight": ("right", pytest.approx(19.0))
    }
    clear = on_path(one_lane, "right", "0-0", 20.0)
    assert Radar(one_lane).leaders([straight, clear]) == {}


def test_the_last_vehicle_on_the_exit_lane_leads_whoever_joins(one_lane: IntersectionMap) -> None:
    length_m = one_lane.movements[index(one_lane, "0-1")].length_m
    joined = on_path(one_lane, "joined", "2-2", one_lane.movements[index(one_lane, "2-2")].length_m + 8.0)
    coming = on_path(one_lane, "coming", "0-1", length_m - 10.0)
    assert Radar(one_lane).leaders([joined, coming]) == {"coming": ("joined", pytest.approx(10.0 + 8.0 - 5.0))}


def test_a_crossing_vehicle_is_no_leader(one_lane: IntersectionMap) -> None:
    assert Radar(one_lane).leaders([on_path(one_lane, "a", "0-1", -1.0), on_path(one_lane, "b", "2-1", 6.0)]) == {}


def test_a_vehicle_on_the_wrong_lane_is_seen_by_those_behind(one_lane: IntersectionMap) -> None:
    lost = Body("lost", None, one_lane.movements[index(one_lane, "0-1")].lane, -5.0, 5.0)
    behind = on_path(one_lane, "behind", "0-1", -30.0)
    assert Radar(one_lane).leaders([lost, behind]) == {"behind": ("lost", 20.0)}
