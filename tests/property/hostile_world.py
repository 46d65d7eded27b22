"""Random traffic under a planner that wants the worst: what must be safe does not depend on the plan.

Point masses drive what they are told (`Car`); the manager is its own pure pieces from the tracker to
`decision.conclude`, with random crossing orders, slots and speeds where candidates and programs would be.
Whatever is checked is checked from the cars' positions and the map, not from the reservations.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from gameopt_im.core import decision, planning
from gameopt_im.core.conflicts import Ground, ground
from gameopt_im.core.decision import Conclusion, Picture, Winner
from gameopt_im.core.interlock import EXITING, Limits
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.tracker import Tracker
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Geometry, State

DT = 0.1
CLASSES = {  # length, width, a, b, top
    "passenger": (5.0, 1.8, 2.6, 4.5, 22.0),
    "truck": (12.0, 2.5, 1.04, 4.0, 19.0),
    "emergency": (6.5, 2.2, 3.0, 6.0, 25.0),
}
EXIT_M = 70.0
TERM = 1
TESTS = Path(__file__).parents[1]
MAPS = {
    "crossroads": TESTS / "maps" / "crossroads.json",
    "four-arm": TESTS.parent / "sumo_gateway" / "gameopt_sumo" / "maps" / "four-arm.json",
}


def road_map(name: str) -> IntersectionMap:
    """A map with short exits: cars are gone `EXIT_M` after the conflict zone."""
    roads = msgspec.json.decode(MAPS[name].read_bytes(), type=IntersectionMap)
    movements = [msgspec.structs.replace(each, exit_length_m=EXIT_M) for each in roads.movements]
    return msgspec.structs.replace(roads, movements=movements)


@dataclass(frozen=True, slots=True)
class Weather:
    """Shares of messages lost and of offers left lying for a while, how often cars on the exit brake hard."""

    geometry: Geometry = "areas"
    slotless: bool = False
    commands_lost: float = 0.0
    states_lost: float = 0.0
    reluctant: float = 0.0
    exit_braking: float = 0.0
    flow: float = 0.3
    """Share of free lanes that a car enters by, each step."""


@dataclass(slots=True)
class Car:
    """x is the front past the line, m; `reservation` the clearance taken, `patience` how long offers lie."""

    name: str
    kind: str
    movement: int
    x: float
    v: float
    patience: int
    reservation: Reservation | None = None
    command: tuple[float, int | None] | None = None
    """(speed, clearance known to be taken) of this step's command, None if it was lost."""
    offer: Reservation | None = None
    braking: int = 0

    def __str__(self) -> str:
        return f"{self.name} ({self.kind}, movement {self.movement}) at {self.x:.2f} m, {self.v:.2f} m/s"

    @property
    def length(self) -> float:
        return CLASSES[self.kind][0]

    @property
    def rear(self) -> float:
        return self.x - self.length

    def room_to_stop(self) -> float:
        return self.v**2 / (2.0 * CLASSES[self.kind][3])


class World:
    """One intersection; `step` is one control cycle and the driving after it."""

    def __init__(self, name: str, weather: Weather, seed: int) -> None:
        self.roads = road_map(name)
        self.weather = weather
        self.parameters = Parameters()
        self.ground: Ground = ground(self.roads, weather.geometry, 25.0, turn_speed=True)
        self.tracker = Tracker(self.roads, self.ground, self.parameters, "lockstep", TERM)
        self.book = Book()
        self.cars: list[Car] = []
        self.cycle = 0
        self.crossed = self.accepted = self.lapsed = self.made = 0
        self.limits: Limits | None = None
        self._next_clearance = 1
        self._rng = np.random.default_rng(seed)

    @property
    def time_s(self) -> float:
        return self.cycle * DT

    def step(self) -> None:
        """Enter, speak, decide, command, drive."""
        self._enter()
        for car in self.cars:
            if self._rng.random() >= self.weather.states_lost or car.x < -145.0:
                assert self.tracker.ingest_state(self._state(car), self.time_s) is None
        snapshot = self.tracker.snapshot(self.cycle, self.time_s, self.book.held.keys())
        settled = decision.settle(self.book, snapshot, self.ground)
        self.accepted += len(settled.accepted)
        self.lapsed += len(settled.lapsed)
        picture = decision.picture(snapshot, self.ground, self.book, self.parameters)
        self.limits = picture.limits
        concluded = self._conclude(snapshot, picture)
        self._send(snapshot, concluded)
        self._drive()
        self.cycle += 1

    def leader_of(self, car: Car) -> tuple[Car, float] | None:
        """The next car ahead on the approach lane, or on the exit lane, with the way to its rear."""
        own = self.roads.movements[car.movement]
        found = []
        for other in self.cars:
            its = self.roads.movements[other.movement]
            if other is car:
                continue
            if its.lane == own.lane and other.x > car.x:
                if other.rear < self.ground.apart[car.movement, other.movement]:  # else it has turned off
                    found.append((other.rear - car.x, other))
            elif its.exit_lane == own.exit_lane and its.lane != own.lane:
                gone, behind = other.x - its.length_m, car.x - own.length_m
                if gone > max(0.0, behind) and (gone >= other.length or behind >= 0.0):
                    found.append((gone - other.length - behind, other))
        if not found:
            return None
        way, other = min(found, key=lambda each: each[0])
        return other, way

    def _enter(self) -> None:
        rng = self._rng
        for lane in range(len(self.roads.lanes)):
            if rng.random() >= self.weather.flow:
                continue
            kind = str(rng.choice(list(CLASSES), p=[0.7, 0.2, 0.1]))
            v, b = float(rng.uniform(5.0, 15.0)), 4.0
            last = min((c.rear for c in self.cars if self._lane(c) == lane), default=1e9)
            if last + 150.0 < 3.0 + v * v / (2.0 * b):
                continue
            choices = [k for k, each in enumerate(self.roads.movements) if each.lane == lane]
            patience = int(rng.integers(1, 9)) if rng.random() < self.weather.reluctant else 0
            self.made += 1
            self.cars.append(Car(f"car {self.made}", kind, int(rng.choice(choices)), -150.0, v, patience))

    def _lane(self, car: Car) -> int:
        return self.roads.movements[car.movement].lane

    def _state(self, car: Car) -> State:
        length, width, a, b, top = CLASSES[car.kind]
        taken = car.reservation
        return State(
            vehicle=car.name, time_s=self.time_s, movement=self.roads.movements[car.movement].id,
            distance_m=-car.x, speed_mps=car.v, acceleration_mps2=0.0, length_m=length, width_m=width,
            vehicle_class=car.kind, max_speed_mps=top, max_accel_mps2=a, max_decel_mps2=b, term=TERM,
            accepted=taken.clearance if taken is not None else None,
        )  # fmt: skip

    def _conclude(self, snapshot: Snapshot, picture: Picture) -> Conclusion:
        rng = self._rng
        who = planning.bidders(snapshot, self.ground, self.book, picture.limits, self.parameters, 1)
        n = len(who)
        s, v = snapshot.s[who.index], snapshot.v[who.index]
        near = s / np.maximum(v, 4.0)
        speeds = np.where(rng.random(n) < 0.1, rng.uniform(0.0, 40.0, n), v + rng.uniform(-0.3, 0.4, n))
        winner = Winner(
            number=0, delay=0.0, order=rng.permutation(n), slots=near * rng.uniform(0.3, 2.0, n),
            speeds=speeds, bids=who.bids[0] if n else np.empty(0),
        )  # fmt: skip
        concluded = decision.conclude(
            snapshot, self.ground, self.book, picture, who, winner if n else None, self.parameters,
            self._next_clearance, self.weather.slotless,
        )  # fmt: skip
        self._next_clearance += len(concluded.grants.given)
        return concluded

    def _send(self, snapshot: Snapshot, concluded: Conclusion) -> None:
        row = {name: i for i, name in enumerate(snapshot.ids)}
        for car in self.cars:
            car.command = None
            i = row.get(car.name)
            if i is None or snapshot.silent[i] or self._rng.random() < self.weather.commands_lost:
                continue
            held = self.book.held.get(car.name)
            taken = held.clearance if held is not None and held.accepted else None
            car.command = float(concluded.speeds[i]), taken
            if held is not None and not held.accepted and held.clearance:
                car.offer = held

    def _drive(self) -> None:
        speeds = [self._speed(car) for car in self.cars]
        for car, u in zip(self.cars, speeds, strict=True):
            car.x += 0.5 * DT * (car.v + u)
            car.v = u
        kept = [car for car in self.cars if car.x < self.roads.movements[car.movement].length_m + EXIT_M]
        self.crossed += len(self.cars) - len(kept)
        self.cars = kept

    def _speed(self, car: Car) -> float:
        """The speed at the end of this step: on the clearance, as commanded, or by the car's own rules."""
        self._consider(car)
        _, _, a, b, top = CLASSES[car.kind]
        taken = car.reservation
        if taken is not None and taken.step(self.cycle) < taken.done:
            k = taken.step(self.cycle)
            drift = taken.x[k] - car.x
            u = float(taken.v[k + 1]) + (float(np.clip(0.5 * drift, -0.3, 0.3)) if abs(drift) > 0.05 else 0.0)
            if car.command is None:
                u = min(u, self._behind(car))
            elif car.command[1] == taken.clearance:
                u = min(u, car.command[0])
        elif car.command is not None:
            u = min(car.command[0], self._behind(car)) if self._exiting(car) else car.command[0]
        else:
            u = min(self._own_limit(car), car.v + 0.5 * a * DT)
        if self._exiting(car):
            if car.braking == 0 and self._rng.random() < self.weather.exit_braking:
                car.braking = int(self._rng.integers(5, 30))
            if car.braking:
                car.braking -= 1
                u = 0.0
        return max(0.0, car.v - b * DT, min(u, car.v + a * DT, top))

    def _exiting(self, car: Car) -> bool:
        movement = self.roads.movements[car.movement]
        clear = max(movement.clear_m, 25.0 if self.weather.geometry == "box" else 0.0)
        return car.rear >= clear and car.x >= movement.length_m

    def _consider(self, car: Car) -> None:
        offer, car.offer = car.offer, None
        if offer is None or car.reservation is not None or self.time_s > offer.expires_s:
            return
        if car.patience:
            car.patience -= 1
            return
        k = offer.step(self.cycle)
        if abs(offer.x[k] - car.x) <= 0.4 and abs(offer.v[k] - car.v) <= 1.2:
            car.reservation = offer

    def _behind(self, car: Car) -> float:
        """Rule 2 by the car's own sensors: to a stand behind a leader that brakes, by bisection."""
        found = self.leader_of(car)
        if found is None:
            return 1e9
        other, way = found
        b = min(CLASSES[car.kind][3], CLASSES[other.kind][3])
        room = way - 2.0 + other.v**2 / (2.0 * CLASSES[other.kind][3])
        return largest(lambda u: 0.5 * DT * (car.v + u) + u * u / (2.0 * b) <= room)

    def setback(self, car: Car) -> float:
        """How far before the line an uncleared car keeps off, m."""
        return max(self.roads.movements[car.movement].setback_m or [0.0])

    def _own_limit(self, car: Car) -> float:
        movement = self.roads.movements[car.movement]
        b = CLASSES[car.kind][3]
        limits = [self._behind(car), movement.exit_speed_mps if car.x > 0.0 else 1e9]
        if car.x < 0.0:
            limits.append(
                largest(lambda u: 0.5 * DT * (car.v + u) + u * u / (2.0 * b) <= -car.x - 1.0 - self.setback(car))
            )
        if movement.turn_speed_mps is not None and car.x < movement.length_m:
            limits.append(movement.turn_speed_mps)
        return min(limits)

    def exiting_phase(self) -> int:
        """How many cars the manager takes to be past the conflict zone."""
        return 0 if self.limits is None else int(np.count_nonzero(self.limits.phase == EXITING))


def largest(allowed: object) -> float:
    """The largest speed that is allowed, by bisection; 0 where none is."""
    assert callable(allowed)
    low, high = 0.0, 60.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low
