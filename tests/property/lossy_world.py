"""Random traffic on bad links: the real manager and the real agents, and every message between them at risk.

Messages are lost, late, overtaken, or all of them gone for many seconds. The planner is random (`Whims`), since what
must be safe does not depend on the plan. What is checked is checked from the cars' positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from hostile_world import CLASSES, DT, TERM, Car, Weather, World

from gameopt_im.core.budget import Ask
from gameopt_im.core.decision import Winner
from gameopt_im.core.interlock import Limits
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.inbox import Raw
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.solver.pool import Counts
from gameopt_im.strategy import Proposal
from gameopt_vehicles.agent import Agent
from gameopt_vehicles.faults import Faults
from gameopt_wire import codec, keys
from gameopt_wire.messages import Command

HERE = "junction"


@dataclass(frozen=True, slots=True)
class Outage:
    """From `start_s` for `length_s` nothing comes through, up or down, to one vehicle in `every`."""

    start_s: float
    length_s: float
    up: bool
    down: bool
    every: int = 1

    def hits(self, number: int, time_s: float) -> bool:
        """Whether it cuts off the vehicle of this number now."""
        return number % self.every == 0 and self.start_s <= time_s < self.start_s + self.length_s


@dataclass(frozen=True, slots=True)
class Link:
    """The radio between vehicles and manager, until `until_s`; afterwards it is perfect."""

    up_lost: float = 0.0
    down_lost: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    outages: tuple[Outage, ...] = ()
    until_s: float = 1e9
    noise_mps: float = 0.0
    """Sigma of the speeds that cars drive, around those they aim at; to the end."""


class Seen(msgspec.Struct, kw_only=True):
    """What a car's own sensors say."""

    vehicle: str
    movement: str
    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    length_m: float
    width_m: float
    vehicle_class: str
    max_speed_mps: float
    max_accel_mps2: float
    max_decel_mps2: float
    leader_gap_m: float | None = None
    leader_strange: bool = False
    leader_speed_mps: float | None = None
    leader_decel_mps2: float | None = None
    controlled: bool = True


@dataclass(slots=True)
class Whims:
    """A planner that wants anything: random orders, slots and speeds, and no programs."""

    slotless: bool
    rng: np.random.Generator

    def propose(
        self, snapshot: Snapshot, book: Book, limits: Limits, who: Bidders, previous: tuple[str, ...], effort: Ask
    ) -> Proposal:
        """Remembers whom there is to plan for."""
        return Proposal(who, (snapshot,), (), None)

    def choose(self, proposal: Proposal, results: Sequence[Any]) -> Winner | None:
        """Anything at all."""
        who, rng, n = proposal.who, self.rng, len(proposal.who)
        if not n:
            return None
        s, v = proposal.candidates[0].s[who.index], proposal.candidates[0].v[who.index]
        speeds = np.where(rng.random(n) < 0.1, rng.uniform(0.0, 40.0, n), v + rng.uniform(-0.3, 0.4, n))
        slots = s / np.maximum(v, 4.0) * rng.uniform(0.3, 2.0, n)
        return Winner(0, 0.0, rng.permutation(n), slots, speeds, who.bids[0])


class NoPrograms:
    """In place of the solver's processes."""

    counts = Counts()

    async def solve(self, jobs: Sequence[Any], deadline_s: float | None = None) -> list[Any]:
        """Nothing to solve."""
        return []


@dataclass(slots=True)
class Radio:
    """Both directions of a `Link`."""

    link: Link
    seed: int
    up: Faults[Raw] = field(init=False)
    down: Faults[Command] = field(init=False)

    def __post_init__(self) -> None:
        self.up = Faults([self.seed, 0], self.link.up_lost, self.link.delay_s, self.link.jitter_s)
        self.down = Faults([self.seed, 1], self.link.down_lost, self.link.delay_s, self.link.jitter_s)

    def cut(self, vehicle: str, time_s: float, *, up: bool) -> bool:
        """Whether an outage swallows a message of or to this vehicle."""
        number = int(vehicle.rsplit(maxsplit=1)[-1])
        return any((each.up if up else each.down) and each.hits(number, time_s) for each in self.link.outages)


class LossyWorld(World):
    """The hostile world, with messages for pure calls."""

    def __init__(self, name: str, weather: Weather, link: Link, seed: int) -> None:
        super().__init__(name, weather, seed)
        self.link = link
        self.radio = Radio(link, seed)
        options = ServeOptions(
            map=self.roads, parameters=self.parameters, geometry=weather.geometry, clock="lockstep", workers=0
        )
        self.manager = Manager(options, TERM, NoPrograms())
        self.manager._strategy = Whims(weather.slotless, np.random.default_rng([seed, 2]))
        self.agents: dict[str, Agent] = {}
        self.entering = True

    async def advance(self) -> None:
        """One control cycle and the driving after it."""
        if self.entering:
            self._enter()
        heard = self._speak()
        outcome = await self.manager.control_cycle(self.cycle, self.time_s, heard)
        self.book = self.manager._book
        for command in self._arrived(outcome.commands):
            if command.vehicle in self.agents:
                self.agents[command.vehicle].receive(command)
        self._act()
        self.cycle += 1

    def cleared(self, car: Car) -> bool:
        """Whether it follows a clearance."""
        return self.agents[car.name]._accepted is not None

    def _speak(self) -> list[Raw]:
        now, perfect = self.time_s, self.time_s >= self.link.until_s
        fresh = []
        for car in self.cars:
            seen = self._seen(car)
            if car.name not in self.agents:
                self.agents[car.name] = self._agent(car, seen)
            agent = self.agents[car.name]
            messages = [("state", codec.STATE.encode(agent.observe(seen, now)))]
            if (bid := agent.bid(now)) is not None:
                messages.append(("bid", codec.BID.encode(bid)))
            for kind, payload in messages:
                raw = Raw(kind, payload, keys.of_vehicle(HERE, kind, car.name))  # type: ignore[arg-type]
                if perfect:
                    fresh.append(raw)
                elif not self.radio.cut(car.name, now, up=True):
                    self.radio.up.push(now, raw)
        return [*self.radio.up.due(now), *fresh]

    def _arrived(self, commands: list[Command]) -> list[Command]:
        now = self.time_s
        if now >= self.link.until_s:
            return [*self.radio.down.due(now), *commands]
        for command in commands:
            if not self.radio.cut(command.vehicle, now, up=False):
                self.radio.down.push(now, command)
        return self.radio.down.due(now)

    def _act(self) -> None:
        speeds = [self.agents[car.name].act(self._seen(car), self.time_s) for car in self.cars]
        for car, u in zip(self.cars, speeds, strict=True):
            car.x += 0.5 * DT * (car.v + u)
            car.v = u
        gone = [car for car in self.cars if car.x >= self.roads.movements[car.movement].length_m + 70.0]
        self.crossed += len(gone)
        for car in gone:
            self.cars.remove(car)
            del self.agents[car.name]

    def _agent(self, car: Car, seen: Seen) -> Agent:
        movement = self.roads.movements[car.movement]
        setback = (
            movement.setback_m[self.roads.footprint_of(seen.length_m, seen.width_m)] if movement.setback_m else 0.0
        )
        lane, noise = self.roads.lanes[movement.lane], self.link.noise_mps
        return Agent(seen, movement, lane, seed=1, setback_m=setback, noise_mps=noise)

    def _seen(self, car: Car) -> Seen:
        length, width, a, b, top = CLASSES[car.kind]
        seen = Seen(
            vehicle=car.name, movement=self.roads.movements[car.movement].id, distance_m=-car.x, speed_mps=car.v,
            acceleration_mps2=0.0, length_m=length, width_m=width, vehicle_class=car.kind, max_speed_mps=top,
            max_accel_mps2=a, max_decel_mps2=b,
        )  # fmt: skip
        found = self.leader_of(car)
        if found is not None:
            other, seen.leader_gap_m = found
            seen.leader_speed_mps, seen.leader_decel_mps2 = other.v, CLASSES[other.kind][3]
        return seen
