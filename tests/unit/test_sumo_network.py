"""The map read from a net: the paper's table, SUMO's own lengths, swept ground, and what is refused."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import pytest
from shapely.geometry import LineString, Point
from shapely.ops import unary_union
from swept import body

from gameopt_sumo.network import NetworkError, map_json, packaged_map, read_map, without_turn_speeds
from gameopt_sumo.scenarios import four_arm_map, sumo_binary, write_net
from gameopt_wire.intersection import IntersectionMap

# table: grouping. Right turns (x-0) are in nobody's way.
PAPERS_TABLE = {
    "0-1": {"0-2", "1-1", "2-2"},
    "0-2": {"0-1", "1-2", "3-1"},
    "1-1": {"0-1", "1-2", "3-2"},
    "1-2": {"0-2", "1-1", "2-1"},
    "2-1": {"1-2", "2-2", "3-1"},
    "2-2": {"0-1", "2-1", "3-2"},
    "3-1": {"0-2", "2-1", "3-2"},
    "3-2": {"1-1", "2-2", "3-1"},
}


@pytest.fixture(scope="module")
def nets(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    directory = tmp_path_factory.mktemp("nets")
    for lanes in (1, 2, 3):
        write_net(lanes, directory / f"{lanes}.net.xml")
    return {lanes: directory / f"{lanes}.net.xml" for lanes in (1, 2, 3)}


@pytest.fixture(scope="module")
def maps(nets: dict[int, Path]) -> dict[int, IntersectionMap]:
    return {lanes: read_map(net) for lanes, net in nets.items()}


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four crossings with two lanes each way, U-turns and internal junctions."""
    net = tmp_path_factory.mktemp("grid") / "grid.net.xml"
    command = [sumo_binary("netgenerate"), "--grid", "--grid.number", "2", "--grid.attach-length", "100"]
    options = ["--default.lanenumber", "2", "--output-file", str(net)]
    subprocess.run([*command, *options], check=True, capture_output=True)
    return net


def conflicts(intersection_map: IntersectionMap) -> set[frozenset[str]]:
    ids = [movement.id for movement in intersection_map.movements]
    return {frozenset((ids[area.a], ids[area.b])) for area in intersection_map.areas if not area.beside}


def test_conflicts_are_exactly_those_of_the_papers_table(maps: dict[int, IntersectionMap]) -> None:
    expected = {frozenset(pair) for pair in combinations(PAPERS_TABLE, 2) if pair[1] not in PAPERS_TABLE[pair[0]]}

    assert conflicts(maps[3]) == expected
    assert not any(area.merge for area in maps[3].areas)


def test_each_lane_has_one_movement_and_roads_are_west_east_north_south(
    maps: dict[int, IntersectionMap],
) -> None:
    of_lane = {maps[3].lanes[m.lane].id: m.id for m in maps[3].movements}

    for road, arm in enumerate("WENS"):
        assert [of_lane[f"{arm}_in_{lane}"] for lane in range(3)] == [f"{road}-{y}" for y in range(3)]
    assert all(lane.zone_m == 150.0 and lane.speed_limit_mps == 20.0 for lane in maps[3].lanes)


def test_lengths_and_turning_speeds_are_sumos(nets: dict[int, Path], maps: dict[int, IntersectionMap]) -> None:
    root = ET.parse(nets[3]).getroot()
    lanes = {lane.get("id"): lane.attrib for lane in root.iter("lane")}
    via = {(c.get("from"), c.get("fromLane")): c.get("via") for c in root.iter("connection")}

    for movement in maps[3].movements:
        edge, _, index = maps[3].lanes[movement.lane].id.rpartition("_")
        length, speed, lane = 0.0, 20.0, via[edge, index]
        while lane:
            length += float(lanes[lane]["length"])
            speed = min(speed, float(lanes[lane]["speed"]))
            inner, _, inner_index = lane.rpartition("_")
            lane = via.get((inner, inner_index))
        assert movement.length_m == pytest.approx(length)
        assert movement.turn_speed_mps == (None if movement.intention == "straight" else speed)
        assert LineString(movement.path).length == pytest.approx(length, abs=0.05)
        assert movement.clear_m >= movement.length_m


def test_right_turns_are_taken_at_city_speed(maps: dict[int, IntersectionMap]) -> None:
    speeds = {m.turn_speed_mps for m in maps[3].movements if m.intention == "right"}
    assert all(speed is not None and 6.0 <= speed <= 9.0 for speed in speeds)
    assert all(m.turn_speed_mps is None for m in without_turn_speeds(maps[3]).movements)


def long_line(movement_path: list[tuple[float, float]]) -> LineString:
    """The path with 60 m straight on at both ends, along the arms, which run north-south and east-west."""
    (x0, y0), (x1, y1) = movement_path[:2]
    (x2, y2), (x3, y3) = movement_path[-2:]
    before = Point(x0, y0).distance(Point(x1, y1))
    after = Point(x2, y2).distance(Point(x3, y3))
    start = (x0 - round((x1 - x0) / before) * 60.0, y0 - round((y1 - y0) / before) * 60.0)
    end = (x3 + round((x3 - x2) / after) * 60.0, y3 + round((y3 - y2) / after) * 60.0)
    return LineString([start, *movement_path, end])


PAIRS = [("0-1", "2-1"), ("0-2", "1-1"), ("0-2", "2-2"), ("1-2", "3-2")]
CROSSINGS = [(a, b, f, g) for a, b in PAIRS for f, g in ((0, 0), (2, 0), (2, 2))]


# A right-turning truck's tail once swung unseen into one that drove past it: (2-0, 2-1) for two trucks.
@pytest.mark.parametrize(("a", "b", "f", "g"), [*CROSSINGS, ("2-0", "2-1", 2, 2)])
def test_windows_cover_the_swept_ground(maps: dict[int, IntersectionMap], a: str, b: str, f: int, g: int) -> None:
    """Against an independent sweep every 5 cm: never short by more than 1 cm, never longer than 0.6 m."""
    ids = [movement.id for movement in maps[3].movements]
    area = next(x for x in maps[3].areas if (ids[x.a], ids[x.b]) == (a, b))
    moved, other = maps[3].movements[area.a], maps[3].movements[area.b]
    size, other_size = maps[3].footprints[f], maps[3].footprints[g]
    line, other_line = long_line(moved.path), long_line(other.path)
    other_fronts = [52.0 + 0.05 * i for i in range(int((other.length_m + other_size.length_m + 16.0) / 0.05))]
    ground = unary_union([body(other_line, x, other_size.length_m, other_size.width_m) for x in other_fronts])

    fronts = [0.05 * i - 8.0 for i in range(int((moved.length_m + size.length_m + 16.0) / 0.05))]
    touched = [x for x in fronts if body(line, 60.0 + x, size.length_m, size.width_m).intersects(ground)]

    window = area.a_windows_m[f][g]
    assert window is not None
    assert touched[0] - 0.6 <= window[0] <= touched[0] + 0.01
    assert touched[-1] - size.length_m - 0.01 <= window[1] <= touched[-1] - size.length_m + 0.6


def test_the_sweep_goes_on_until_nobody_cuts_over_the_exit_any_more(maps: dict[int, IntersectionMap]) -> None:
    """A truck that turns left out of the arm beside an exit lane cuts over its first metres, up to 5 m for two."""
    beyond = 0.0
    for area in (area for area in maps[3].areas if not area.merge):
        for index, windows in ((area.a, area.a_windows_m), (area.b, area.b_windows_m)):
            ends = [window[1] for row in windows for window in row if window]
            beyond = max(beyond, max(ends, default=0.0) - maps[3].movements[index].length_m)
    assert 4.0 < beyond < 7.0


def test_one_lane_has_merges_and_none_between_movements_of_one_lane(maps: dict[int, IntersectionMap]) -> None:
    movements = maps[1].movements
    for area in maps[1].areas:
        assert movements[area.a].lane != movements[area.b].lane
        assert area.merge == (movements[area.a].exit_lane == movements[area.b].exit_lane)
    merging = {area.a for area in maps[1].areas if area.merge} | {area.b for area in maps[1].areas if area.merge}
    assert merging == set(range(len(movements)))


def test_merge_windows_end_on_the_exit_lane(maps: dict[int, IntersectionMap]) -> None:
    for area in (area for area in maps[1].areas if area.merge):
        for index, windows in ((area.a, area.a_windows_m), (area.b, area.b_windows_m)):
            for window in (window for row in windows for window in row):
                assert window is not None
                assert 0.0 <= window[1] - maps[1].movements[index].length_m <= 0.5


def test_two_lanes_let_right_turns_merge_with_straight(maps: dict[int, IntersectionMap]) -> None:
    assert frozenset(("0-0", "2-1")) in conflicts(maps[2])
    assert frozenset(("0-0", "2-2")) not in conflicts(maps[2])


def test_a_net_of_several_junctions_needs_a_name(grid: Path) -> None:
    with pytest.raises(NetworkError, match=r"4 candidates; name one with --junction: A0, A1, B0, B1"):
        read_map(grid)


def test_u_turns_and_shared_groups_of_a_general_junction(grid: Path) -> None:
    found = read_map(grid, "A0")

    assert found.intersection == "A0"
    assert {"right", "straight", "left", "turnaround"} == {m.intention for m in found.movements}
    ids = [m.id for m in found.movements]
    assert len(set(ids)) == len(ids)
    shared = [m for m in found.movements if m.group == "0-1"]
    assert [m.id for m in shared] == ["0-1.0", "0-1.1"]
    assert all(lane.zone_m <= 100.0 for lane in found.lanes)
    assert {a for (a,) in {(m.group[0],) for m in found.movements}} == set("0123")


def test_the_packaged_map_is_the_default_scenarios() -> None:
    assert four_arm_map().digest() == packaged_map().digest()


def test_json_of_a_map_is_deterministic(nets: dict[int, Path], maps: dict[int, IntersectionMap]) -> None:
    assert map_json(read_map(nets[3])) == map_json(maps[3])


def test_unknown_junction_lists_the_candidates(nets: dict[int, Path]) -> None:
    with pytest.raises(NetworkError, match=r"no junction 'nowhere'; candidates: junction$"):
        read_map(nets[3], "nowhere")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "no such file"),
        (b"", "not a SUMO net"),
        (b"<net version='1.20'><edge", "not a SUMO net"),
        (b"\xff\xfe\x00garbage", "not a SUMO net"),
        (b"<routes/>", "no junction"),
        (b"<net><junction id='a' type='priority'/></net>", "broken SUMO net"),
    ],
)
def test_a_file_that_is_no_net_is_one_line(tmp_path: Path, content: bytes | None, reason: str) -> None:
    net = tmp_path / "broken.net.xml"
    if content is not None:
        net.write_bytes(content)
    with pytest.raises(NetworkError, match=reason) as caught:
        read_map(net)
    assert str(net) in str(caught.value)
    assert "\n" not in str(caught.value)
