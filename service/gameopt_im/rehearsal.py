"""Made-up traffic that does as it is told: to warm the manager up on, and to measure its decisions with.

Point masses on the map's own lanes, as many present as are asked for and fit. They take every offer, drive their
profiles exactly, and obey commands otherwise; whoever has left is replaced at the start of a control zone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gameopt_im.inbox import Raw
from gameopt_wire import codec, keys, motion
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import STEP_S, Bid, Clearance, Command, State

BODIES: dict[str, tuple[float, float, float, float, float]] = {
    "passenger": (0.85, 5.0, 1.8, 2.6, 4.5),
    "truck": (0.12, 7.1, 2.4, 1.3, 4.0),
    "emergency": (0.03, 6.5, 2.16, 2.6, 4.5),
}
"""Per class: its share, length and width in m, acceleration and deceleration in m/s^2."""
WATCHED_M = 250.0
"""Vehicles are present for this long after the conflict zone, or to the end of their exit."""
PLACE_M = 8.0
"""Of a lane, for each vehicle that stands there at the start."""
PLAY_M = 0.5


@dataclass(slots=True)
class Extra:
    """One vehicle: x is its front past the stop line, m; `clearance` what it follows."""

    name: str
    kind: str
    movement: int
    x: float
    v: float
    speaks_bid: float | None
    term: int = 0
    clearance: Clearance | None = None
    target: float = 0.0


class Rehearsal:
    """`present` vehicles on a map; the same for the same seed and the same commands."""

    def __init__(self, intersection: IntersectionMap, present: int, seed: int = 1) -> None:
        self._map = intersection
        self._present = present
        self._random = np.random.default_rng(seed)
        self._extras: dict[str, Extra] = {}
        self._made = 0
        self._movements_of: dict[int, list[int]] = {}
        for index, movement in enumerate(intersection.movements):
            self._movements_of.setdefault(movement.lane, []).append(index)
        self._fill()

    def messages(self, time_s: float) -> list[Raw]:
        """The states of everybody, and the bids of newcomers."""
        raw = []
        for extra in self._extras.values():
            state = codec.STATE.encode(self._state(extra, time_s))
            raw.append(Raw("state", state, self._key("state", extra)))
            if extra.speaks_bid is not None:
                bid = Bid(vehicle=extra.name, time_s=time_s, assertiveness=extra.speaks_bid)
                raw.append(Raw("bid", codec.BID.encode(bid), self._key("bid", extra)))
                extra.speaks_bid = None
        return raw

    def obey(self, commands: list[Command]) -> None:
        """Drive for a control cycle as commanded; then who has left is replaced."""
        for waiting in self._extras.values():
            if waiting.x < 0.0 and waiting.clearance is None:  # and without a command: it brakes
                waiting.target = max(0.0, waiting.v - BODIES[waiting.kind][4] * STEP_S)
        for command in commands:
            extra = self._extras.get(command.vehicle)
            if extra is None:
                continue  # it has left, and its last state is answered
            if command.withdrawn is not None and extra.clearance is not None:
                extra.clearance = None
            elif extra.clearance is None and command.clearance is not None:
                extra.clearance, extra.term = command.clearance, command.term
            extra.target = _target(extra, command)
        for extra in list(self._extras.values()):
            extra.x += 0.5 * STEP_S * (extra.v + extra.target)
            extra.v = extra.target
            self._leave(extra)
        for lane in self._random.permutation(sorted(self._movements_of)).tolist():
            if len(self._extras) < self._present:
                self._enter(lane)

    def _key(self, kind: Literal["state", "bid"], extra: Extra) -> str:
        return keys.of_vehicle(self._map.intersection, kind, extra.name)

    def _state(self, extra: Extra, time_s: float) -> State:
        _, length, width, accel, decel = BODIES[extra.kind]
        movement = self._map.movements[extra.movement]
        return State(
            vehicle=extra.name,
            time_s=time_s,
            movement=movement.id,
            distance_m=-extra.x,
            speed_mps=extra.v,
            acceleration_mps2=0.0,
            length_m=length,
            width_m=width,
            vehicle_class=extra.kind,
            max_speed_mps=self._map.lanes[movement.lane].speed_limit_mps,
            max_accel_mps2=accel,
            max_decel_mps2=decel,
            term=extra.term,
            accepted=extra.clearance.id if extra.clearance else None,
        )

    def _leave(self, extra: Extra) -> None:
        movement = self._map.movements[extra.movement]
        beyond = extra.x - movement.length_m
        if beyond >= 0.0 and extra.x - BODIES[extra.kind][1] >= movement.clear_m:
            extra.clearance = None
        if beyond >= min(WATCHED_M, movement.exit_length_m):
            del self._extras[extra.name]

    def _fill(self) -> None:
        """The lanes evenly filled, standing in queues from the line back."""
        lanes = sorted(self._movements_of)
        for number, lane in enumerate(lanes):
            room = int(self._map.lanes[lane].zone_m / PLACE_M) - 1
            for place in range(min(room, len(range(number, self._present, len(lanes))))):
                self._place(lane, -PLACE_M * (place + 1), 0.0)

    def _enter(self, lane: int) -> None:
        """A newcomer at the start of the zone, as fast as lets it stop behind the one ahead, and at the line."""
        road, decel = self._map.lanes[lane], BODIES["truck"][4]
        rooms = [
            (each.x - BODIES[each.kind][1] + road.zone_m - motion.REAR_GAP_M - PLAY_M, each.v)
            for each in self._extras.values()
            if self._lane(each) == lane
        ]
        room, ahead = min([(road.zone_m - 2.0, 0.0), *rooms])
        if room > 0.0:
            stops = room + ahead**2 / (2.0 * BODIES["passenger"][4])
            self._place(
                lane, -road.zone_m, min(road.speed_limit_mps, motion.brake_speed(stops, 0.0, decel, STEP_S, 0.0))
            )

    def _lane(self, extra: Extra) -> int:
        return self._map.movements[extra.movement].lane

    def _place(self, lane: int, x: float, v: float) -> None:
        self._made += 1
        kind = str(self._random.choice(list(BODIES), p=[body[0] for body in BODIES.values()]))
        movement = int(self._random.choice(self._movements_of[lane]))
        name = f"{kind}.{self._made}"
        bid = float(self._random.uniform(1.0, 10.0))
        self._extras[name] = Extra(name, kind, movement, x, max(0.0, v), bid, target=max(0.0, v))


def _target(extra: Extra, command: Command) -> float:
    """The speed at the end of this control cycle: its profile's as long as there is one, else the command's."""
    clearance = extra.clearance
    if clearance is None:
        return command.speed_mps
    step = math.floor((command.time_s - clearance.start_s) / STEP_S + 0.5) + 1
    if step >= len(clearance.speeds_mps):
        return command.speed_mps
    planned = clearance.speeds_mps[step]
    return min(planned, command.speed_mps) if command.cleared == clearance.id else planned
