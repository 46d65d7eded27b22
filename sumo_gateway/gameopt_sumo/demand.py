"""Poisson demand for a four-arm intersection, as SUMO's route file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

ARMS = "WENS"
"""West, east, north, south: roads 0, 1, 2, 3 of the movement groups."""
Turns = tuple[float, float, float]

_CLOCKWISE = "NESW"


@dataclass(frozen=True)
class VehicleType:
    """What a vehicle type is to SUMO; lengths in m, accelerations in m/s^2, speeds in m/s."""

    v_class: str
    length_m: float
    width_m: float
    accel_mps2: float
    decel_mps2: float
    emergency_decel_mps2: float
    max_speed_mps: float
    emission_class: str
    shape: str


VEHICLE_TYPES: Mapping[str, VehicleType] = MappingProxyType(
    {
        "car": VehicleType("passenger", 5.0, 1.8, 2.6, 4.5, 9.0, 50.0, "HBEFA3/PC_G_EU4", "passenger"),
        "truck": VehicleType("truck", 10.0, 2.5, 1.04, 4.0, 7.0, 36.0, "HBEFA3/HDV_D_EU4", "truck"),
        "emergency": VehicleType("emergency", 6.5, 2.1, 2.9, 4.5, 9.0, 50.0, "HBEFA3/LDV_D_EU4", "emergency"),
        # A car of another class: the report shows its figures apart, and its drivers can be given their own wishes.
        "taxi": VehicleType("taxi", 5.0, 1.8, 2.6, 4.5, 9.0, 50.0, "HBEFA3/PC_G_EU4", "taxi"),
    }
)


def exit_arm(arm: str, intention: int) -> str:
    """The arm by which a vehicle from `arm` leaves: intention 0 right, 1 straight, 2 left."""
    # Seen from above, a right turn leaves by the next arm counter-clockwise.
    return _CLOCKWISE[(_CLOCKWISE.index(arm) - 1 - intention) % 4]


def lane_of(intention: int, lanes: int) -> int:
    """The approach lane (0 rightmost) of intention 0 right, 1 straight, 2 left."""
    return {3: (0, 1, 2), 2: (0, 0, 1), 1: (0, 0, 0)}[lanes][intention]


def routes_xml(
    *,
    flows_veh_h: Mapping[str, float],
    turns: Turns,
    classes: Mapping[str, float],
    lanes: int,
    seed: int,
    duration_s: float,
) -> str:
    """Vehicle types, routes and departures in order of time.

    Every arm and intention has a random stream of its own, so that changing one flow leaves the others'
    arrivals as they are.
    """
    departures = []
    names = list(classes)
    for a, arm in enumerate(ARMS):
        for intention, share in enumerate(turns):
            stream = np.random.default_rng([seed, a, intention])
            for time_s in arrivals(stream, flows_veh_h[arm] * share, duration_s):
                kind = names[int(stream.choice(len(names), p=list(classes.values())))]
                departures.append((time_s, a, intention, kind))
    departures.sort()
    lines = ["<routes>", *type_lines(), *_route_lines()]
    count = dict.fromkeys(names, 0)
    for time_s, a, intention, kind in departures:
        lines.append(
            f'    <vehicle id="{kind}.{count[kind]}" type="{kind}" route="{a}-{intention}" '
            f'depart="{time_s:.2f}" departLane="{lane_of(intention, lanes)}" '
            'departSpeed="max" departPos="base"/>'
        )
        count[kind] += 1
    return "\n".join((*lines, "</routes>", ""))


def arrivals(stream: np.random.Generator, flow_veh_h: float, duration_s: float) -> list[float]:
    """Arrival times of a Poisson process, s."""
    times: list[float] = []
    if flow_veh_h > 0.0:
        time_s = float(stream.exponential(3600.0 / flow_veh_h))
        while time_s < duration_s:
            times.append(time_s)
            time_s += float(stream.exponential(3600.0 / flow_veh_h))
    return times


def type_lines() -> list[str]:
    # No randomness in driving and no lane changes of choice: each departs on its movement's lane and stays
    # there.
    driver = (
        'minGap="2.5" tau="1.0" sigma="0" speedFactor="1" speedDev="0" '
        'lcSpeedGain="0" lcKeepRight="0" lcCooperative="0"'
    )
    return [
        f'    <vType id="{name}" vClass="{t.v_class}" length="{t.length_m}" width="{t.width_m}" '
        f'accel="{t.accel_mps2}" decel="{t.decel_mps2}" emergencyDecel="{t.emergency_decel_mps2}" '
        f'maxSpeed="{t.max_speed_mps}" {driver} emissionClass="{t.emission_class}" guiShape="{t.shape}"/>'
        for name, t in VEHICLE_TYPES.items()
    ]


def _route_lines() -> list[str]:
    return [
        f'    <route id="{a}-{i}" edges="{arm}_in {exit_arm(arm, i)}_out"/>'
        for a, arm in enumerate(ARMS)
        for i in range(3)
    ]
