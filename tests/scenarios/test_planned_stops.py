"""Vehicles that stop of their own accord, as a bus does, on the way to the line or on the exit."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import DEMAND_FILE, FourArm, write_four_arm

pytestmark = pytest.mark.slow

EVERY = 6
HALT_S = 8.0


def with_stops(config: Path, in_m: float, out_m: float) -> Path:
    """Of every six vehicles one stops on its approach, and another on its exit."""
    demand = config.with_name(DEMAND_FILE)
    tree = ElementTree.parse(demand)
    routes = {route.get("id"): str(route.get("edges")).split() for route in tree.iter("route")}
    for number, vehicle in enumerate(tree.iter("vehicle")):
        approach, leaves_by = routes[vehicle.get("route")]
        place = {0: (approach, in_m), 3: (leaves_by, out_m)}.get(number % EVERY)
        if place is not None:
            lane = f"{place[0]}_{vehicle.get('departLane')}"
            ElementTree.SubElement(vehicle, "stop", lane=lane, endPos=f"{place[1]:.1f}", duration=f"{HALT_S:.1f}")
    tree.write(demand)
    return config


@pytest.mark.parametrize("in_m", [260.0, 390.0, 403.5])
def test_nobody_collides_with_those_who_stop(tmp_path: Path, in_m: float) -> None:
    """Just inside the control zone, 14 m before the line, and half a metre before it, nearer than they may come.

    On the exits 90 m past the conflict zone.
    """
    config = write_four_arm(FourArm(flow_veh_h=3_600.0, seed=5, duration_s=100.0), tmp_path)
    found = in_a_process(sumocfg=str(with_stops(config, in_m, 90.0)), duration_s=130.0)
    vehicles, safety = found["vehicles"], found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert found["standing"] == []
    assert vehicles["crossed"] > 0.95 * vehicles["entered"]  # also those who changed lanes to pass one, and back
