"""Junctions of other shapes in the closed loop: nobody collides, and nobody is left standing."""

from __future__ import annotations

from pathlib import Path

import pytest
import sumo
from closed_loop import in_a_process
from sites import site

pytestmark = pytest.mark.slow

FLOWS_VEH_H = {
    "t-junction": 2400.0, "five-arm": 2400.0, "single-lane": 1600.0, "shared-lane": 3000.0, "fan": 2000.0,
    "cross": 3000.0, "rilsa-3": 2400.0, "square": 1400.0,
}  # fmt: skip
DURATION_S = 90.0


@pytest.mark.parametrize(("name", "flow_veh_h"), FLOWS_VEH_H.items())
def test_nobody_collides_and_everybody_gets_across(tmp_path: Path, name: str, flow_veh_h: float) -> None:
    place = site(name, tmp_path)
    config = place.scenario(tmp_path, flow_veh_h, 7, DURATION_S)
    found = in_a_process(sumocfg=str(config), junction=place.junction, duration_s=DURATION_S)
    vehicles, safety = found["vehicles"], found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert vehicles["entered"] > 20
    assert vehicles["crossed"] > 0.5 * vehicles["entered"]
    assert found["rejected"] == {}
    assert safety["hard_brakes"] <= 0.1 * vehicles["entered"]


BLOCKED_S = 60.0
BREAKDOWN = (
    '<vehicle id="broken" type="truck" depart="0.00" departPos="{at_m}"><route edges="{exit_edge}"/>'
    '<stop lane="{exit_edge}_0" endPos="{until_m}" duration="{duration_s}"/></vehicle>'
)


@pytest.mark.parametrize(("name", "exit_edge"), [("single-lane", "east_out"), ("cross", "2o")])
def test_a_full_exit_stops_clearances_and_nobody_in_the_zone(tmp_path: Path, name: str, exit_edge: str) -> None:
    """A truck breaks down on an exit and blocks it for a minute; then everybody bound for it gets across after all."""
    place = site(name, tmp_path)
    config = place.scenario(tmp_path, 1400.0, 3, DURATION_S)
    demand = tmp_path / "demand.rou.xml"
    truck = BREAKDOWN.format(exit_edge=exit_edge, at_m=35.0, until_m=50.0, duration_s=BLOCKED_S)
    demand.write_text(demand.read_text().replace("<vehicle", truck + "<vehicle", 1))

    found = in_a_process(sumocfg=str(config), junction=place.junction, duration_s=DURATION_S + 40.0)
    safety = found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == 0
    assert found["standing"] == []
    assert found["vehicles"]["in_zone"] == 0
    assert found["vehicles"]["crossed"] > 20


def test_vehicles_wait_for_the_next_junction_clear_of_this_one(tmp_path: Path) -> None:
    """It is 20.6 m from where the exit begins, and they have to yield there to a busy road."""
    place = site("near-junction", tmp_path)
    config = place.scenario(tmp_path, 1200.0, 7, DURATION_S)
    demand = tmp_path / "demand.rou.xml"
    onward = (
        demand.read_text()
        .replace('near_out"', 'near_out east_out"')
        .replace('edges="near_in', 'edges="east_in near_in')
    )
    demand.write_text(onward.replace("<vehicle", BUSY_ROAD + "<vehicle", 1))

    found = in_a_process(sumocfg=str(config), junction=place.junction, duration_s=DURATION_S + 30.0)
    safety = found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert found["standing"] == []
    assert found["vehicles"]["crossed"] > 20
    assert found["vehicles"]["in_zone"] <= 2


BUSY_ROAD = (
    '<flow id="busy" type="car" begin="0" end="90" vehsPerHour="800" departSpeed="max">'
    '<route edges="next_north_in next_south_out"/></flow>'
)


REROUTER = (
    '<additional><rerouter id="elsewhere" edges="west_in north_in"><interval begin="0" end="1000">'
    '<destProbReroute id="south_out"/><destProbReroute id="east_out"/></interval></rerouter></additional>'
)


def test_who_is_given_another_route_keeps_its_movement(tmp_path: Path) -> None:
    """In the zone, on the way from the widening to the line, SUMO sends everybody elsewhere; nobody is left over."""
    place = site("fan", tmp_path)
    config = place.scenario(tmp_path, 1600.0, 7, DURATION_S)
    (tmp_path / "elsewhere.add.xml").write_text(REROUTER)
    files = '<additional-files value="elsewhere.add.xml"/></input>'
    config.write_text(config.read_text().replace("</input>", files))

    found = in_a_process(sumocfg=str(config), junction=place.junction, duration_s=DURATION_S + 40.0)
    safety = found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert found["rejected"] == {}
    assert found["vehicles"]["in_zone"] == 0
    assert found["vehicles"]["crossed"] > 20


@pytest.mark.parametrize(("name", "junction"), [("cross", "0"), ("grid6", "1/0")])
def test_a_shipped_scenario_runs_as_it_is(name: str, junction: str) -> None:
    """With its own vehicle types, routes and lights; at grid6 there is another junction 66 m after the exit.

    At cross there are trucks with trailers, of 16 m.
    """
    config = Path(sumo.SUMO_HOME, "tools", "game", f"{name}.sumocfg")
    found = in_a_process(sumocfg=str(config), junction=junction, duration_s=100.0, articulated=True)
    assert found["safety"]["collisions_sumo"] == found["safety"]["collisions_geometric"] == 0
    assert found["vehicles"]["crossed"] > 10
