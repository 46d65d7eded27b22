"""A tracker on a small crossroads, and the states and bids it is fed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from gameopt_im.core.conflicts import ground
from gameopt_im.core.parameters import Parameters, Service
from gameopt_im.tracker import Event, Tracker
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Bid, Clock, State

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
TERM = 3
LENGTH_M, CLEAR_M = 5.0, 20.0
SERVICE = Parameters().service


def tracker(clock: Clock = "lockstep", roads: IntersectionMap = ROADS, **service: Any) -> Tracker:
    parameters = Parameters(service=Service(**service))
    return Tracker(roads, ground(roads, "areas", 25.0, turn_speed=True), parameters, clock, TERM)


def with_exits_of(length_m: float) -> IntersectionMap:
    movements = [msgspec.structs.replace(movement, exit_length_m=length_m) for movement in ROADS.movements]
    return msgspec.structs.replace(ROADS, movements=movements)


def state(vehicle: str = "a", time_s: float = 10.0, **changes: Any) -> State:
    values: dict[str, Any] = {
        "vehicle": vehicle,
        "time_s": time_s,
        "movement": "0-1",
        "distance_m": 100.0,
        "speed_mps": 15.0,
        "acceleration_mps2": 0.0,
        "length_m": LENGTH_M,
        "width_m": 1.8,
        "vehicle_class": "passenger",
        "max_speed_mps": 50.0,
        "max_accel_mps2": 2.6,
        "max_decel_mps2": 4.5,
    }
    return State(**(values | changes))


def bid(vehicle: str = "a", time_s: float = 10.0, assertiveness: float = 3.0) -> Bid:
    return Bid(vehicle=vehicle, time_s=time_s, assertiveness=assertiveness)


def fates(events: list[Event]) -> list[tuple[str, str]]:
    return [(event.vehicle, event.kind) for event in events]
