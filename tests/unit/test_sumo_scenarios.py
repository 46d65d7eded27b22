"""Scenarios: the same bytes for the same parameters, the demand that was asked for, and what is refused."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from gameopt_sumo.scenarios import FourArm, ScenarioError, write_four_arm

FILES = ("four-arm.net.xml", "four-arm.rou.xml", "four-arm.sumocfg")


def written(directory: Path, **parameters: Any) -> dict[str, bytes]:
    write_four_arm(FourArm(**parameters), directory)
    return {name: (directory / name).read_bytes() for name in FILES}


def vehicles(files: dict[str, bytes]) -> list[dict[str, str]]:
    return [vehicle.attrib for vehicle in ET.fromstring(files["four-arm.rou.xml"]).iter("vehicle")]


def test_same_parameters_give_the_same_bytes(tmp_path: Path) -> None:
    first = written(tmp_path / "a", seed=7, duration_s=120.0)
    assert first == written(tmp_path / "b", seed=7, duration_s=120.0)
    other = written(tmp_path / "c", seed=8, duration_s=120.0)
    assert other["four-arm.net.xml"] == first["four-arm.net.xml"]
    assert other["four-arm.rou.xml"] != first["four-arm.rou.xml"]


def test_no_path_and_no_date_is_written(tmp_path: Path) -> None:
    for content in written(tmp_path, duration_s=10.0).values():
        assert str(tmp_path).encode() not in content
        assert b"generated on" not in content


def test_demand_has_the_flow_the_shares_and_the_order_asked_for(tmp_path: Path) -> None:
    found = vehicles(written(tmp_path, flow_veh_h=6000.0, ratio=4.0, seed=3, duration_s=3600.0))

    # Poisson: 4 standard deviations of 6000.
    assert abs(len(found) - 6000) < 4 * 6000**0.5
    arms = Counter(vehicle["route"][0] for vehicle in found)
    assert (arms["0"] + arms["1"]) / (arms["2"] + arms["3"]) == pytest.approx(4.0, rel=0.15)
    turns = Counter(vehicle["route"][2] for vehicle in found)
    assert turns["1"] / len(found) == pytest.approx(0.5, abs=0.03)
    classes = Counter(vehicle["type"] for vehicle in found)
    assert classes["truck"] / len(found) == pytest.approx(0.12, abs=0.02)
    times = [float(vehicle["depart"]) for vehicle in found]
    assert times == sorted(times)
    assert all(re.fullmatch(r"(car|truck|emergency)\.\d+", vehicle["id"]) for vehicle in found)
    assert len({vehicle["id"] for vehicle in found}) == len(found)


def test_arm_flows_replace_flow_and_ratio(tmp_path: Path) -> None:
    found = vehicles(written(tmp_path, arm_flows_veh_h=(3600.0, 0.0, 0.0, 0.0), duration_s=600.0))
    assert {vehicle["route"][0] for vehicle in found} == {"0"}
    assert abs(len(found) - 600) < 100


def test_one_flow_leaves_the_other_arrivals_alone(tmp_path: Path) -> None:
    """The stream of an arm depends on its own flow only, so two ratios share what they can."""
    few = vehicles(written(tmp_path / "a", arm_flows_veh_h=(600.0, 600.0, 0.0, 0.0), duration_s=300.0))
    more = vehicles(written(tmp_path / "b", arm_flows_veh_h=(600.0, 900.0, 0.0, 0.0), duration_s=300.0))
    west = [[v["depart"] for v in found if v["route"][0] == "0"] for found in (few, more)]
    assert west[0] == west[1]


@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_vehicles_depart_on_their_movements_lane(tmp_path: Path, lanes: int) -> None:
    expected = {1: "000", 2: "001", 3: "012"}[lanes]
    for vehicle in vehicles(written(tmp_path, lanes=lanes, duration_s=60.0)):
        assert vehicle["departLane"] == expected[int(vehicle["route"][2])]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"flow_veh_h": 0.0}, "flow is 0 veh/h, allowed: above 0"),
        ({"flow_veh_h": float("nan")}, "flow is nan"),
        ({"ratio": -1.0}, "ratio is -1"),
        ({"arm_flows_veh_h": (1.0, 2.0, 3.0, -4.0)}, "arm-flows must each be 0 to 10000"),
        ({"arm_flows_veh_h": (0.0, 0.0, 0.0, 0.0)}, "at least one above 0"),
        ({"turns": (0.5, 0.5, 0.5)}, "turns must be shares that add up to 1"),
        ({"turns": (float("nan"), 0.5, 0.5)}, "turns must be shares"),
        ({"classes": {"car": 0.5, "tank": 0.5}}, "classes has 'tank', allowed: car, truck, emergency, taxi"),
        ({"classes": {"car": 0.5}}, "classes must be shares that add up to 1"),
        ({"lanes": 4}, "lanes is 4, allowed: 1, 2, 3"),
        ({"seed": -1}, "seed is -1"),
        ({"duration_s": float("inf")}, "duration is inf s"),
    ],
)
def test_a_parameter_out_of_range_is_named(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(message)) as caught:
        FourArm(**parameters)
    assert "\n" not in str(caught.value)
