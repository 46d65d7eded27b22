"""What the unit tests of agents share: a vehicle turning left, its exact kinematics, offers made to it."""

from __future__ import annotations

from typing import Any

import msgspec
from builders import movement

from gameopt_vehicles.agent import Agent
from gameopt_wire.intersection import Lane
from gameopt_wire.messages import STEP_S, Clearance, Command, State

LANE = Lane(id="lane", approach=0, speed_limit_mps=20.0, zone_m=150.0)
MOVEMENT = movement(2, exit_speed_mps=15.0, length_m=30.0, clear_m=25.0, turn_speed_mps=10.0)


class Seen(msgspec.Struct, kw_only=True):
    vehicle: str = "car"
    movement: str = "0-2"
    distance_m: float = 100.0
    speed_mps: float = 15.0
    acceleration_mps2: float = 0.0
    length_m: float = 5.0
    width_m: float = 1.8
    vehicle_class: str = "passenger"
    max_speed_mps: float = 20.0
    max_accel_mps2: float = 2.6
    max_decel_mps2: float = 4.5
    leader_gap_m: float | None = None
    leader_strange: bool = False
    leader_speed_mps: float | None = None
    leader_decel_mps2: float | None = None
    controlled: bool = True


class Drive:
    """An agent and the exact kinematics of its vehicle, one step at a time."""

    def __init__(self, start: Seen | None = None, **agent: Any) -> None:
        self.seen = start or Seen()
        self.agent = Agent(self.seen, MOVEMENT, LANE, **({"seed": 1} | agent))
        self.k = 0
        self.state = self.agent.observe(self.seen, 0.0)

    @property
    def time_s(self) -> float:
        return self.k / 10

    def command(self, **fields: Any) -> None:
        base: dict[str, Any] = {"vehicle": "car", "term": 1, "cycle": self.k, "time_s": self.time_s, "speed_mps": 12.0}
        base["valid_until_s"] = self.time_s + 0.5
        self.agent.receive(Command(**(base | fields)))

    def step(self, push_m: float = 0.0) -> State:
        speed = self.agent.act(self.seen, self.time_s)
        self.seen.distance_m -= 0.5 * STEP_S * (self.seen.speed_mps + speed) - push_m
        self.seen.speed_mps = speed
        self.k += 1
        self.state = self.agent.observe(self.seen, self.time_s)
        return self.state


def offer(drive: Drive, number: int = 5, **fields: Any) -> Clearance:
    """From its present speed on, 0.1 m/s faster every step."""
    speeds = [drive.seen.speed_mps + 0.1 * k for k in range(40)]
    base: dict[str, Any] = {"id": number, "start_s": drive.time_s, "expires_s": drive.time_s + 0.5}
    base["speeds_mps"] = speeds
    return Clearance(**(base | fields))
