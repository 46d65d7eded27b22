"""The loop: move the road one step, let every agent speak, hear the manager, let every agent act.

Two clocks, one path. In lock-step the fleet announces each step with the number of messages it sent and waits
for the control cycle's report and all its commands; under the wall clock it steps on an absolute grid of
100 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import msgspec

from gameopt_vehicles.agent import Agent
from gameopt_vehicles.bus import Bus, NoManager
from gameopt_vehicles.faults import Faults
from gameopt_vehicles.road import Observation, Road
from gameopt_vehicles.strategies import Strategy, truthful
from gameopt_vehicles.tally import Tally
from gameopt_vehicles.together import Together
from gameopt_wire import codec, keys
from gameopt_wire.messages import Clock, Command, CycleReport, Step

STEPS_PER_S = 10
"""1 / STEP_S as an integer: time k is k / STEPS_PER_S, which is the nearest float; k * 0.1 is not."""
SILENCE_S = 10.0
"""In lock-step, a manager that has not answered a step in full after this long never will."""
EARLY_STEPS = 0.01
"""A timer that fires this fraction of a step early has fired on the grid point."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """How the fleet runs. Times in simulated seconds; delay and jitter run on the chosen clock."""

    clock: Clock = "lockstep"
    duration_s: float = 300.0
    warmup_s: float = 0.0
    seed: int = 1
    strategy: Strategy = truthful
    aggressiveness: Mapping[str, float] = msgspec.field(default_factory=dict)
    """By vehicle class, where it is not each vehicle's own; it stays inside the agents."""
    turn_speed: bool = True
    tracking_noise_mps: float = 0.0
    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0


class Progress(NamedTuple):
    """What the progress bar shows after a step."""

    time_s: float
    vehicles: int
    control_cycle_ms: float


class _Member(NamedTuple):
    agent: Agent
    state_key: str
    bid_key: str


class _Outgoing(NamedTuple):
    """A message on its way out; `asks` is whose it is, and the control cycle, if a command is to answer it."""

    key: str
    payload: bytes
    asks: tuple[str, int] | None = None


class Fleet:
    """All agents on one road, on one bus that has joined its intersection; several fleets step `together`."""

    def __init__(
        self,
        road: Road,
        bus: Bus,
        settings: Settings,
        *,
        together: Together | None = None,
        on_step: Callable[[Progress], None] | None = None,
        wall_s: Callable[[], float] = time.time,
    ) -> None:
        self.tally = Tally()
        self._road = road
        self._bus = bus
        self._settings = settings
        self._together = together or Together(1)
        self._on_step = on_step
        self._wall_s = wall_s
        self._lockstep = settings.clock == "lockstep"
        self._movements = {movement.id: movement for movement in road.map.movements}
        self._members: dict[str, _Member] = {}
        channel = (settings.loss, settings.delay_s, settings.jitter_s)
        self._uplink: Faults[_Outgoing] = Faults([settings.seed, 0], *channel)
        self._downlink: Faults[Command] = Faults([settings.seed, 1], *channel)
        self._lost_in_warmup = 0
        self._now_s = 0.0
        self._mark: bytes | None = None
        self._batch: list[Command] = []
        self._answered: set[str] = set()
        self._report: CycleReport | None = None
        self._stopping = False

    @property
    def lost(self) -> int:
        """Messages lost on purpose, both ways, since the warm-up."""
        return self._uplink.lost + self._downlink.lost - self._lost_in_warmup

    def stop(self) -> None:
        """End after the current step; safe from a signal handler of the event loop."""
        self._stopping = True
        self._bus.wake()

    async def run(self) -> None:
        """Drive until the duration is over or `stop`; raises `NoManager` when lock-step gets no answer."""
        try:
            await self._run()
        finally:
            self._together.leave()

    async def _run(self) -> None:
        start_s = self._road.time_s
        warming_up = self._settings.warmup_s > 0.0
        cycle = self._grid_point()
        if not self._lockstep:
            await self._until_grid_point(cycle + 1)
        while not self._stopping and (ran_s := self._road.time_s - start_s + 1e-6) < self._settings.duration_s:
            if warming_up and ran_s >= self._settings.warmup_s:
                warming_up = False
                self.tally.restart()
                self._lost_in_warmup += self.lost
            await self._together.all_here()
            cycle = self._next_cycle(cycle)
            self._now_s = cycle / STEPS_PER_S
            self._mark = codec.step_mark(cycle) if self._lockstep else None
            observations = [seen for seen in self._road.step() if seen.controlled]
            sent = self._speak(observations, cycle)
            if self._lockstep:
                await self._answers(cycle, sent)
            else:
                await self._until_grid_point(cycle + 1)
            if not self._stopping:
                self._drive(observations)
            self._show()

    def _next_cycle(self, last: int) -> int:
        """The control cycle of the coming step: simulated time in lock-step, else the grid point it falls on.

        A late step is counted and left out, so simulated time falls behind; it is never caught up in a burst.
        """
        if self._lockstep:
            return round(self._road.time_s * STEPS_PER_S) + 1
        cycle = max(last + 1, self._grid_point())
        self.tally.late_steps += cycle - last - 1
        return cycle

    def _grid_point(self) -> int:
        return int(self._wall_s() * STEPS_PER_S + EARLY_STEPS)

    def _speak(self, observations: Sequence[Observation], cycle: int) -> int:
        """Publish every state and bid that is due; how many messages really went out."""
        push_s = self._clock_s()
        present = {seen.vehicle for seen in observations}
        for vehicle in [vehicle for vehicle in self._members if vehicle not in present]:
            self._end(vehicle)
        for seen in observations:
            member = self._members.get(seen.vehicle) or self._begin(seen)
            state = member.agent.observe(seen, self._now_s)
            self._uplink.push(push_s, _Outgoing(member.state_key, codec.STATE.encode(state), (seen.vehicle, cycle)))
            if (bid := member.agent.bid(self._now_s)) is not None:
                self._uplink.push(push_s, _Outgoing(member.bid_key, codec.BID.encode(bid)))
        return self._send_due()

    def _send_due(self) -> int:
        due = self._uplink.due(self._clock_s())
        for key, payload, asks in due:
            if asks is not None and asks[0] in self._members:  # a delayed state of who has left waits for nothing
                self.tally.round_trips.asked(*asks, time.monotonic())
            self._bus.put(key, payload, self._mark)
        self.tally.sent += len(due)
        return len(due)

    async def _answers(self, cycle: int, sent: int) -> None:
        """Lock-step: announce the step, then wait for its report and as many commands as that counts."""
        self._answered.clear()
        step = Step(cycle=cycle, time_s=self._now_s, messages=sent)
        self._bus.put(keys.step(self._bus.intersection), codec.STEP.encode(step))
        began_s = time.monotonic()
        while not self._stopping:
            self._hear(cycle)
            report = self._report
            if report is not None and report.cycle == cycle and len(self._answered) >= report.commands:
                break
            if self._bus.presence and not self._bus.presence[-1]:
                raise NoManager(f"the manager of {self._bus.intersection!r} has gone")
            left_s = began_s + SILENCE_S - time.monotonic()
            if left_s <= 0.0 or not await self._bus.wait(left_s):
                raise NoManager(
                    f"the manager of {self._bus.intersection!r} stopped answering at {self._now_s:.1f} s "
                    f"(waited {SILENCE_S:g} s)"
                )
        # The order in which commands arrive is nobody's promise; the order of the road is.
        position = {vehicle: k for k, vehicle in enumerate(self._members)}
        self._batch.sort(key=lambda command: (position[command.vehicle], command.term, command.cycle))
        self._deliver()

    async def _until_grid_point(self, cycle: int) -> None:
        """Wall clock: hear commands and send what the delay has held back until the grid point has come."""
        while not self._stopping and (left_s := cycle / STEPS_PER_S - self._wall_s()) > 0.0:
            next_due_s = self._uplink.next_due_s()
            if next_due_s is not None:
                left_s = min(left_s, max(0.0, next_due_s - self._wall_s()))
            await self._bus.wait(left_s)
            self._send_due()
            self._hear()
            self._deliver()

    def _hear(self, answering: int | None = None) -> None:
        """Read what has arrived, and whom the control cycle `answering` has answered."""
        while self._bus.commands:
            at_s, payload = self._bus.commands.popleft()
            try:
                command = codec.COMMAND.decode(payload)
            except codec.Rejected:
                self.tally.rejected += 1
                continue
            self.tally.heard(command, at_s)
            if command.cycle == answering:
                self._answered.add(command.vehicle)
            if command.vehicle in self._members:
                self._batch.append(command)
        while self._bus.reports:
            try:
                self._report = codec.CYCLE.decode(self._bus.reports.popleft().payload)
            except codec.Rejected:
                self.tally.rejected += 1
            else:
                self.tally.add(self._report)

    def _deliver(self) -> None:
        """Give the commands heard to the downlink, which may lose or delay them."""
        now_s = self._clock_s()
        for command in self._batch:
            self._downlink.push(now_s, command)
        self._batch.clear()

    def _drive(self, observations: Sequence[Observation]) -> None:
        """Give every agent its commands and set its next speed."""
        for command in self._downlink.due(self._clock_s()):
            if command.vehicle in self._members:
                self._members[command.vehicle].agent.receive(command)
        for seen in observations:
            agent = self._members[seen.vehicle].agent
            before = agent.fallbacks
            self._road.set_speed(seen.vehicle, agent.act(seen, self._now_s))
            self.tally.fallbacks += agent.fallbacks - before

    def _clock_s(self) -> float:
        """The clock that faults run on: simulated time in lock-step, the time of day under the wall clock."""
        return self._now_s if self._lockstep else self._wall_s()

    def _begin(self, seen: Observation) -> _Member:
        movement = self._movements[seen.movement]
        settings = self._settings
        agent = Agent(
            seen,
            movement,
            self._road.map.lanes[movement.lane],
            seed=settings.seed,
            setback_m=self._road.map.setback_of(movement, seen.length_m, seen.width_m),
            strategy=settings.strategy,
            aggressiveness=settings.aggressiveness.get(seen.vehicle_class),
            turn_speed=settings.turn_speed,
            noise_mps=settings.tracking_noise_mps,
        )
        name, vehicle = self._bus.intersection, seen.vehicle
        member = _Member(agent, keys.of_vehicle(name, "state", vehicle), keys.of_vehicle(name, "bid", vehicle))
        self._members[vehicle] = member
        if not self._lockstep:
            # In lock-step only what is counted may reach the manager: a token comes and goes at its own time.
            self._bus.announce(vehicle)
        return member

    def _end(self, vehicle: str) -> None:
        del self._members[vehicle]
        self.tally.round_trips.gone(vehicle)
        if not self._lockstep:
            self._bus.withdraw(vehicle)

    def _show(self) -> None:
        if self._on_step is not None:
            elapsed_ms = self.tally.elapsed_ms[-1] if self.tally.elapsed_ms else 0.0
            self._on_step(Progress(self._road.time_s, len(self._members), elapsed_ms))
