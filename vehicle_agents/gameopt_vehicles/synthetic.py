"""A road without SUMO: point masses on the manager's own map, to put load on a live manager.

It keeps a given number of vehicles present as far as there is room: each that leaves is replaced by one at
the start of the control zone. Exact ballistic kinematics; no collisions are counted, that needs bodies.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gameopt_wire import motion
from gameopt_wire.intersection import IntersectionMap, Lane
from gameopt_wire.messages import STEP_S

EXIT_RANGE_M = 250.0
"""A vehicle leaves the road this far along its exit lane, or where that ends."""
ENTRY_HEADWAY_S = 1.2
ROOM_M = 2.0
"""Nobody appears nearer than this to where it may have to stop; rule 1 asks for half of it."""
# share, length m, width m, acceleration m/s^2, deceleration m/s^2; what SUMO gives these classes by default
CLASSES: dict[str, tuple[float, float, float, float, float]] = {
    "passenger": (0.85, 5.0, 1.8, 2.6, 4.5),
    "truck": (0.12, 7.1, 2.4, 1.3, 4.0),
    "emergency": (0.03, 6.5, 2.16, 2.6, 4.5),
}


@dataclass(slots=True)
class SyntheticVehicle:
    """A point mass that knows its own body; it is its own observation."""

    vehicle: str
    movement: str
    distance_m: float
    speed_mps: float
    length_m: float
    width_m: float
    vehicle_class: str
    max_speed_mps: float
    max_accel_mps2: float
    max_decel_mps2: float
    movement_index: int
    entered_s: float
    acceleration_mps2: float = 0.0
    leader_gap_m: float | None = None
    leader_strange: bool = False
    leader_speed_mps: float | None = None
    leader_decel_mps2: float | None = None
    target_mps: float = 0.0
    crossed: bool = False
    controlled: bool = True


class SyntheticRoad:
    """`Road` with `present` vehicles on the map; the same for the same seed and the same speeds set."""

    def __init__(self, intersection: IntersectionMap, present: int, seed: int) -> None:
        self.map = intersection
        self.flow_veh_h = self.ratio = None  # a number of vehicles is kept up, not a flow
        self._present = present
        self._random = np.random.default_rng([seed, 2])
        self._vehicles: dict[str, SyntheticVehicle] = {}
        self._step = 0
        self._entered = 0
        self._goal_times_s: list[float] = []
        by_lane: dict[int, list[int]] = defaultdict(list)
        for index, movement in enumerate(intersection.movements):
            by_lane[movement.lane].append(index)
        self._movements_of = dict(by_lane)
        self._fill()
        self._look_ahead()

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self._step / 10

    def step(self) -> list[SyntheticVehicle]:
        """Move everybody, let newcomers in, update every radar."""
        self._step += 1
        for car in list(self._vehicles.values()):
            self._move(car)
        for lane in self._random.permutation(sorted(self._movements_of)).tolist():
            if len(self._vehicles) < self._present:
                self._enter(lane)
        self._look_ahead()
        return list(self._vehicles.values())

    def set_speed(self, vehicle: str, speed_mps: float) -> None:
        """The speed `vehicle` has at the end of the next step."""
        self._vehicles[vehicle].target_mps = speed_mps

    def close(self) -> None:
        """Nothing to close."""

    def measurements(self, warmup_s: float) -> dict[str, object]:
        """What point masses can tell: counts, throughput and time to goal of those across since the start."""
        del warmup_s  # load, not traffic, is measured here
        times = self._goal_times_s
        p50, p95, worst = np.percentile(times, [50, 95, 100]).tolist() if times else (None, None, None)
        on_approach = sum(not car.crossed for car in self._vehicles.values())
        counts = {"entered": self._entered, "crossed": len(times), "in_zone": on_approach}
        mean = sum(times) / len(times) if times else None
        return {
            "vehicles": counts,
            "throughput_veh_min": len(times) / self.time_s * 60.0 if self._step else None,
            "time_to_goal_s": {"mean": mean, "p50": p50, "p95": p95, "max": worst},
        }

    def _move(self, car: SyntheticVehicle) -> None:
        movement = self.map.movements[car.movement_index]
        car.acceleration_mps2 = (car.target_mps - car.speed_mps) / STEP_S
        car.distance_m -= 0.5 * STEP_S * (car.speed_mps + car.target_mps)
        car.speed_mps = car.target_mps
        beyond_m = -car.distance_m - movement.length_m
        if beyond_m >= 0.0 and not car.crossed:
            car.crossed = True
            self._goal_times_s.append(self.time_s - car.entered_s)
        if beyond_m >= min(EXIT_RANGE_M, max(movement.exit_length_m, car.length_m)):
            del self._vehicles[car.vehicle]

    def _fill(self) -> None:
        """At the start: the lanes evenly filled, back to front, as fast as each can still stop."""
        lanes = sorted(self._movements_of)
        for index, lane in enumerate(lanes):
            share = len(range(index, self._present, len(lanes)))
            zone_m = self.map.lanes[lane].zone_m
            setbacks_m = [max(self.map.movements[each].setback_m, default=0.0) for each in self._movements_of[lane]]
            queue_m = zone_m - max(setbacks_m)
            # A body and its standing gap need 10 m; what does not fit now enters later.
            count = min(share, int(queue_m / 10.0))
            for k in range(count):
                self._place(lane, zone_m - queue_m * (count - 1 - k) / count)

    def _enter(self, lane: int) -> None:
        zone_m = self.map.lanes[lane].zone_m
        tails = [car.distance_m + car.length_m for car in self._on_approach(lane)]
        if not tails or zone_m - max(tails) > 2.0 * motion.REAR_GAP_M:
            self._place(lane, zone_m)

    def _on_approach(self, lane: int) -> list[SyntheticVehicle]:
        """Those on the lane, up to the one whose rear has just left it."""
        movements = self._movements_of[lane]
        cars = self._vehicles.values()
        return [c for c in cars if c.movement_index in movements and c.distance_m > -c.length_m]

    def _place(self, lane: int, distance_m: float) -> None:
        """A new vehicle, at the speed from which it can follow the one ahead, or stop at the line."""
        self._entered += 1
        index = int(self._random.choice(self._movements_of[lane]))
        names = list(CLASSES)
        kind = names[int(self._random.choice(len(names), p=[CLASSES[name][0] for name in names]))]
        _, length_m, width_m, accel, decel = CLASSES[kind]
        ahead = [c for c in self._on_approach(lane) if c.distance_m < distance_m]
        limit = self.map.lanes[lane].speed_limit_mps
        room_m = distance_m - self.map.setback_of(self.map.movements[index], length_m, width_m) - ROOM_M
        speed = _entry_speed(self.map.lanes[lane], distance_m, room_m, decel, ahead)
        name = f"{kind}.{self._entered}"
        self._vehicles[name] = SyntheticVehicle(
            name, self.map.movements[index].id, distance_m, speed, length_m, width_m, kind,
            limit, accel, decel, index, self.time_s, target_mps=speed,
        )  # fmt: skip

    def _look_ahead(self) -> None:
        """Every radar: the nearest rear ahead on the approach lane, then on the path and the exit lane."""
        files: dict[tuple[str, object], list[tuple[float, SyntheticVehicle]]] = defaultdict(list)
        for car in self._vehicles.values():
            car.leader_gap_m = car.leader_speed_mps = car.leader_decel_mps2 = None
            movement = self.map.movements[car.movement_index]
            if car.distance_m > -car.length_m:
                files["lane", movement.lane].append((car.distance_m, car))
            files["path", car.movement_index].append((car.distance_m, car))
            if car.distance_m <= 0.0:
                files["exit", movement.exit_lane].append((car.distance_m + movement.length_m, car))
        for members in files.values():
            members.sort(key=lambda member: (member[0], member[1].vehicle))
            for (ahead_m, leader), (own_m, car) in pairwise(members):
                gap_m = own_m - ahead_m - leader.length_m
                if car.leader_gap_m is None or gap_m < car.leader_gap_m:
                    car.leader_gap_m, car.leader_speed_mps = gap_m, leader.speed_mps
                    car.leader_decel_mps2 = leader.max_decel_mps2


def _entry_speed(lane: Lane, distance_m: float, room_m: float, decel: float, ahead: list[SyntheticVehicle]) -> float:
    """From v dt + v^2 / (2 b) <= room: the speed from which a vehicle can stop short of what is ahead."""
    speed = min(lane.speed_limit_mps, motion.brake_speed(room_m, 0.0, decel, 2 * STEP_S, 0.0))
    if ahead:
        leader = max(ahead, key=lambda car: car.distance_m)
        gap_m = distance_m - leader.distance_m - leader.length_m - motion.REAR_GAP_M
        braking_m = leader.speed_mps**2 / (2.0 * leader.max_decel_mps2)
        speed = min(speed, max(0.0, motion.brake_speed(gap_m + braking_m, 0.0, decel, 2 * STEP_S, 0.0)))
        speed = min(speed, max(0.0, gap_m) / ENTRY_HEADWAY_S + 0.5 * leader.speed_mps)
    return max(0.0, speed)
