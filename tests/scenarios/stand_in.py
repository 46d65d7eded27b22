"""A stand-in for the manager: a real Zenoh session that speaks its side of the wire."""

from __future__ import annotations

import asyncio
import os
import socket
from collections import deque
from collections.abc import Callable, Collection, Coroutine
from typing import Any, Self, cast

import uvloop
import zenoh

from gameopt_im.clock import WallClock
from gameopt_im.inbox import Kind, Raw
from gameopt_im.roll_call import RollCall
from gameopt_wire import codec, keys
from gameopt_wire.intersection import Charter, ConflictArea, Footprint, IntersectionMap, Lane, Movement
from gameopt_wire.messages import Bid, Clearance, Command, CycleReport, State

MAP = IntersectionMap(
    intersection="main/1",  # a name that the keys have to encode
    control_zone_m=150.0,
    lanes=[Lane(id=f"lane{k}", approach=k, speed_limit_mps=20.0, zone_m=150.0) for k in range(2)],
    movements=[
        Movement(
            id=f"{k}-1",
            group=f"{k}-1",
            lane=k,
            exit_lane=f"exit{k}",
            exit_speed_mps=20.0,
            exit_length_m=100.0,
            intention="straight",
            length_m=30.0,
            clear_m=25.0,
            turn_speed_mps=None,
            path=[(0.0, 0.0), (30.0, 0.0)],
        )
        for k in range(2)
    ],
    footprints=[Footprint(name="car", length_m=5.0, width_m=1.8)],
    areas=[ConflictArea(a=0, b=1, merge=False, a_windows_m=[[(8.0, 20.0)]], b_windows_m=[[(8.0, 20.0)]])],
)
COLLECT_S = 0.03
"""How long after a grid point of the wall clock it answers: the states for that point are in by then."""
Decide = Callable[["StandIn", list[State], int, float], list[Command]]


def hold_speed(manager: StandIn, states: list[State], cycle: int, time_s: float) -> list[Command]:
    """Clear everybody at once, at the speed it has: no traffic management, but every message of it."""
    commands = []
    for state in states:
        offer = None
        if state.accepted is None and state.distance_m > 0.0:
            number = manager.offers.setdefault(state.vehicle, len(manager.offers))
            speeds = [max(5.0, state.speed_mps)] * 300
            offer = Clearance(id=number, start_s=time_s, expires_s=time_s + 0.5, speeds_mps=speeds)
        commands.append(
            Command(
                vehicle=state.vehicle,
                term=manager.charter.term,
                cycle=cycle,
                time_s=time_s,
                speed_mps=max(5.0, state.speed_mps),
                valid_until_s=time_s + 0.5,
                clearance=offer,
            )
        )
    return commands


class Inbox:
    """What has come off the network, as the manager's clocks take it; Zenoh's threads put it in."""

    def __init__(self) -> None:
        self._messages: deque[Raw] = deque()
        self._awake = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._roll_call = RollCall(self._loop)

    def put(self, raw: Raw) -> None:
        self._messages.append(raw)
        self._loop.call_soon_threadsafe(self._awake.set)
        self._roll_call.heard(raw.key)

    def drain(self) -> list[Raw]:
        self._awake.clear()  # before it is emptied, so that a message coming now is not slept through
        return [self._messages.popleft() for _ in range(len(self._messages))]

    async def arrival(self) -> None:
        await self._awake.wait()

    def call_roll(self, whom: Collection[str], since_s: float) -> None:
        self._roll_call.begin(whom, since_s)

    async def all_heard(self, most_s: float) -> bool:
        return await self._roll_call.complete(most_s)


class StandIn:
    """A hub with a map, a token and a `decide`; answers lock-steps, or the wall clock's grid."""

    def __init__(self, decide: Decide = hold_speed, **charter: Any) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        about = {
            "term": 7,
            "clock": "lockstep",
            "profile": "default",
            "geometry": "areas",
            "turn_speed": True,
        }
        about |= {
            "candidates": 1,
            "workers": 0,
            "process_id": os.getpid(),
            "digest": MAP.digest(),
            "map": MAP,
        }
        self.charter = Charter(**(about | charter))
        self.offers: dict[str, int] = {}
        self.states: list[State] = []
        self.bids: list[Bid] = []
        self.traffic: list[bytes] = []
        self.tokens: list[tuple[zenoh.SampleKind, str]] = []
        self.answered = asyncio.Event()
        self._decide = decide
        self._inbox = Inbox()

    async def __aenter__(self) -> Self:
        config = zenoh.Config()
        for key, value in {
            "mode": '"router"',
            "listen/endpoints": f'["{self.endpoint}"]',
            "scouting/multicast/enabled": "false",
            "scouting/gossip/enabled": "false",
        }.items():
            config.insert_json5(key, value)
        self._session = await asyncio.to_thread(zenoh.open, config)
        name = self.charter.map.intersection
        answer = codec.CHARTER.encode(self.charter)
        map_key = keys.intersection_map(name)
        self._declared = [
            self._session.declare_subscriber(f"gameopt/{keys.encode(name)}/**", self._arrived),
            self._session.declare_queryable(map_key, lambda query: query.reply(map_key, answer)),
            self._session.liveliness().declare_subscriber(
                keys.alive(name, "*").replace("%2A", "*"),
                lambda sample: self.tokens.append((sample.kind, keys.vehicle_of(str(sample.key_expr)))),
            ),
            self._session.liveliness().declare_token(keys.alive(name, "manager")),
        ]
        serve = self._serve_wall if self.charter.clock == "wall" else self._serve_lockstep
        self._task = asyncio.create_task(serve())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await asyncio.to_thread(self._session.close)

    def _arrived(self, sample: zenoh.Sample) -> None:
        stream = str(sample.key_expr).split("/")[2]
        if stream in ("state", "bid", "step"):
            self._inbox.put(Raw(cast(Kind, stream), sample.payload.to_bytes(), str(sample.key_expr)))

    async def _serve_lockstep(self) -> None:
        states: list[State] = []
        count, step = 0, None
        while True:
            for raw in self._inbox.drain():
                count += raw.kind != "step"
                if raw.kind == "step":
                    step = codec.STEP.decode(raw.payload)
                else:
                    self._take(raw, states)
            if step is not None and count == step.messages:
                latest = {state.vehicle: state for state in states}  # delays may bring two at once
                self._answer(list(latest.values()), step.cycle, step.time_s)
                states, count, step = [], 0, None
            await self._inbox.arrival()

    async def _serve_wall(self) -> None:
        clock = WallClock(self._inbox, COLLECT_S)
        while True:
            tick = await clock.next_cycle()
            states: list[State] = []
            for raw in tick.messages:
                self._take(raw, states)
            latest = {state.vehicle: state for state in states}
            self._answer(list(latest.values()), tick.cycle, tick.time_s)

    def _take(self, raw: Raw, states: list[State]) -> None:
        self.traffic.append(raw.payload)
        if raw.kind == "state":
            states.append(codec.STATE.decode(raw.payload))
        elif raw.kind == "bid":
            self.bids.append(codec.BID.decode(raw.payload))

    def _answer(self, states: list[State], cycle: int, time_s: float) -> None:
        self.states += states
        commands = self._decide(self, states, cycle, time_s)
        name = self.charter.map.intersection
        for command in commands:
            self._session.put(keys.of_vehicle(name, "command", command.vehicle), codec.COMMAND.encode(command))
        counts = {"vehicles": len(states), "uncleared": 0, "cleared": 0, "commands": len(commands)}
        counts |= {"candidates": 1, "selected": 0, "fallback": 0, "silent": 0, "received_total": 0}
        totals = {"qp_solved_total": cycle, "qp_failed_total": 0, "qp_late_total": 0, "missed_total": 0}
        report = CycleReport(
            term=self.charter.term,
            cycle=cycle,
            time_s=time_s,
            order=[],
            granted=[],
            delay_s=0.0,
            elapsed_ms=1.5,
            stages_ms={},
            rejected_total={},
            **counts,
            **totals,
        )
        self._session.put(keys.cycle(name), codec.CYCLE.encode(report))
        self.answered.set()


def run(scenario: Callable[[], Coroutine[Any, Any, None]]) -> None:
    with asyncio.Runner(debug=True, loop_factory=uvloop.new_event_loop) as runner:
        runner.run(scenario())
