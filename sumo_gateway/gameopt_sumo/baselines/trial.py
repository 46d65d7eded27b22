"""How good a plan is, found out quickly: SUMO runs alone, and only vehicles are counted.

A measured run costs thirty times as much, most of it for bodies and fuel. What is counted here is what the meter
counts, without its fractions of a second; a test holds them together.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import msgspec

from gameopt_sumo import readings
from gameopt_sumo.junction import choose, links_over, read_net
from gameopt_sumo.network import DEFAULT_CONTROL_ZONE_M
from gameopt_sumo.run_files import Hush

COUNT_EVERY_S = 1.0


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One plan on one seed's arrivals."""

    seed: int
    unserved: int
    """Vehicles due at the control zone by the end and not in it or across: arrived - crossed - in_zone."""
    collisions: int
    """Pairs that SUMO saw colliding."""
    mean_time_s: float
    """From scheduled departure to goal, the wait upstream included: vehicle-seconds spent in the measuring window,
    also by those who are not across at its end, over the vehicles scheduled in it. The delay is this less a
    constant of the arrivals."""


def drive(config: Path, net_file: Path, demand: Path, seed: int, duration_s: float, warmup_s: float) -> Trial:
    """Run a four-arm scenario on `net_file` for `duration_s`. Raises `SimulationError`, `NetworkError`.

    The time that vehicles spend is the number of those under way, summed over time.
    """
    net = read_net(net_file)
    links = links_over(net, choose(net, net_file, None))
    approaches = list(dict.fromkeys(link.lane for link in links))
    inside = [lane.getID() for link in links for lane in link.internal]
    under_way = [*(lane.getID() for lane in approaches), *dict.fromkeys(inside)]
    departures_s = _departures_s(demand)
    hush = Hush()
    collided = net_file.with_suffix(".collisions.xml")
    own = ("--net-file", str(net_file), "--collision-output", str(collided))
    readings.start(config, seed, False, own, hush)
    try:
        vehicle_s, time_s = 0.0, 0.0
        while time_s < duration_s:
            step_s = min(COUNT_EVERY_S, duration_s - time_s)
            time_s += step_s
            readings.advance(time_s, hush)
            if time_s > warmup_s:
                count = sum(readings.count_on(lane) for lane in under_way) + readings.count_pending()
                vehicle_s += step_s * count
        outside = readings.count_pending() + sum(_upstream(lane.getID(), lane.getLength()) for lane in approaches)
    finally:
        readings.end(hush)
        hush.close()
    scheduled = sum(warmup_s < at_s <= duration_s for at_s in departures_s)
    ways_s = [(lane.getLength() - DEFAULT_CONTROL_ZONE_M) / lane.getSpeed() for lane in approaches]
    due = sum(at_s + max(ways_s) <= duration_s for at_s in departures_s)
    entered = sum(at_s <= duration_s for at_s in departures_s) - outside
    return Trial(
        seed=seed,
        unserved=max(0, due - entered),
        collisions=_pairs(collided),
        mean_time_s=round(vehicle_s / max(1, scheduled), 3),
    )


def _upstream(lane: str, length_m: float) -> int:
    """Vehicles on an approach lane that have not reached the control zone."""
    zone_from_m = length_m - DEFAULT_CONTROL_ZONE_M
    return sum(readings.position_m(vehicle) < zone_from_m for vehicle in readings.vehicles_on(lane))


def _departures_s(demand: Path) -> Sequence[float]:
    return [float(found.get("depart", 0.0)) for _, found in ET.iterparse(demand) if found.tag == "vehicle"]


def _pairs(collided: Path) -> int:
    """SUMO writes a pair down at every step of its collision."""
    found = (element for _, element in ET.iterparse(collided) if element.tag == "collision")
    return len({frozenset((element.get("collider"), element.get("victim"))) for element in found})
