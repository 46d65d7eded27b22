"""The control zone upstream of the approach: over edges where nobody yields, up to where somebody does."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from plain_nets import CENTRE, build_plain
from sites import site

from gameopt_sumo.layout import Layout
from gameopt_sumo.network import read_layout
from gameopt_sumo.radar import LET_IN_M, Body, Radar
from gameopt_sumo.upstream import SLOWEST_MPS, entry_speed_mps


@pytest.fixture(scope="module")
def fan(tmp_path_factory: pytest.TempPathFactory) -> Layout:
    return read_layout(build_plain("fan", tmp_path_factory.mktemp("fan")), CENTRE)


def zones(layout: Layout) -> dict[str, float]:
    return {lane.id: lane.zone_m for lane in layout.map.lanes}


def test_it_reaches_over_a_widening_to_the_road_before(fan: Layout) -> None:
    assert {lane: zones(fan)[lane] for lane in ("west_in_0", "west_in_1", "west_in_2")} == {
        "west_in_0": 150.0, "west_in_1": 150.0, "west_in_2": 150.0
    }  # fmt: skip
    west = {lane.id: index for index, lane in enumerate(fan.map.lanes) if lane.id.startswith("west_in")}
    place = fan.places["west_far_0"]
    assert place.kind == "upstream"
    assert place.limit_mps == 16.67
    assert set(place.offsets_m) == set(west.values())
    for lane, index in west.items():
        (shared,) = fan.shared[index]
        assert shared.lane == "west_far_0"
        assert shared.begin_m == place.offsets_m[index]
        assert shared.end_m == fan.places[lane].offset_m


def test_it_ends_where_a_side_road_joins(fan: Layout) -> None:
    """And who comes by that junction is slow enough to stop before the line."""
    zone_m = zones(fan)["north_in_0"]
    assert zone_m == -fan.places["north_in_0"].offset_m < 80.0
    assert set(fan.gates_mps) == {":side_0_0", ":side_1_0"}
    for speed_mps in fan.gates_mps.values():
        assert speed_mps**2 / (2.0 * 3.0) < zone_m - 1.0


def test_a_roads_beginning_needs_no_gate(fan: Layout) -> None:
    assert zones(fan)["east_in_0"] == 150.0
    assert not any("east" in gate for gate in fan.gates_mps)


def test_a_configured_zone_is_kept_to(tmp_path: Path) -> None:
    layout = read_layout(build_plain("fan", tmp_path), CENTRE, control_zone_m=40.0)
    assert set(zones(layout).values()) == {40.0}
    assert layout.gates_mps == {}
    assert not any(place.kind == "upstream" for place in layout.places.values())


def test_shipped_nets(tmp_path: Path) -> None:
    """SUMO's `cross` widens 130 m before the line; the junctions of its `square` have lights, 86 m apart."""
    for name, expected in (("cross", {150.0}), ("square", {85.6, 150.0})):
        place = site(name, tmp_path)
        found = {round(zone_m, 1) for zone_m in zones(read_layout(place.net, place.junction)).values()}
        assert found == expected


def test_a_short_zone_is_entered_slowly_but_always_can_be() -> None:
    assert entry_speed_mps(151.0, 0.0) == pytest.approx(30.0)
    assert entry_speed_mps(10.0, 3.0) == pytest.approx(math.sqrt(36.0))
    assert entry_speed_mps(2.0, 4.0) == SLOWEST_MPS


def coming(layout: Layout, vehicle: str, lane: str, past_line_m: float) -> Body:
    """A car on its way to an approach lane."""
    index = next(i for i, found in enumerate(layout.map.lanes) if found.id == lane)
    movement = next(i for i, found in enumerate(layout.map.movements) if found.lane == index)
    shared = tuple(
        (way.lane, past_line_m - way.begin_m, way.end_m - way.begin_m)
        for way in layout.shared[index]
        if past_line_m - 5.0 < way.end_m and past_line_m >= way.begin_m
    )
    return Body(vehicle, movement, index, past_line_m, 5.0, shared=shared)


def test_on_a_shared_road_whoever_is_ahead_leads_wherever_it_is_bound(fan: Layout) -> None:
    ahead, behind = coming(fan, "left", "west_in_2", -80.0), coming(fan, "right", "west_in_0", -100.0)
    assert Radar(fan.map).leaders([behind, ahead]) == {"right": ("left", pytest.approx(15.0))}


def test_until_its_rear_has_left_the_shared_road(fan: Layout) -> None:
    line_m = fan.places["west_in_0"].offset_m
    behind = coming(fan, "right", "west_in_0", line_m - 30.0)
    for rear_m, leads in ((line_m - 0.5, True), (line_m + 0.5, False)):
        found = Radar(fan.map).leaders([behind, coming(fan, "left", "west_in_2", rear_m + 5.0)])
        assert ("right" in found) == leads
    beside = coming(fan, "beside", "west_in_0", line_m + 1.0)
    assert Radar(fan.map).leaders([beside, coming(fan, "left", "west_in_2", line_m + 3.0)]) == {}


def test_whoever_has_to_change_lanes_is_let_in_from_behind_but_not_from_beside(fan: Layout) -> None:
    lanes = [lane.id for lane in fan.map.lanes]
    left = lanes.index("west_in_2")
    lost = Body("lost", None, lanes.index("west_in_0"), -20.0, 5.0, wants=((left, -20.0),))
    for past_line_m, leads in ((-40.0, True), (-24.0, False), (-10.0, False)):
        found = Radar(fan.map).leaders([lost, coming(fan, "other", "west_in_2", past_line_m)])
        assert (found.get("other") == ("lost", pytest.approx(-25.0 - LET_IN_M - past_line_m))) == leads
        assert "lost" not in found
