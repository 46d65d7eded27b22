"""The Zenoh side of the manager: bytes in, bytes out, nothing decided.

Zenoh calls back from its own threads, one per subscriber. A callback only appends to a deque and wakes the
event loop, once until the next drain; it makes no Zenoh call, save the reply to a query, which is prebuilt.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from functools import partial
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Self

import zenoh

from gameopt_im.inbox import Kind, Raw
from gameopt_im.options import StartError
from gameopt_im.roll_call import RollCall
from gameopt_wire import codec, keys, transport
from gameopt_wire.messages import Command, CycleReport, LedgerEntry

MAX_QUEUED, MAX_QUEUED_BYTES = 100_000, 64 * 2**20
"""Messages held for the next control cycle, and their content; what comes beyond is dropped and counted."""
MANAGER = "manager"
DECLARED_AT_ONCE = 20
"""Publishers declared or taken back after a control cycle, of either: a crowd that comes or goes may not delay it."""
PROBE_S = 1.0
"""Longest wait for an answer whether another manager is there; it normally comes within a millisecond."""

_OS_ERROR = re.compile(r"\(os error (\d+)\)")


class BusError(StartError):
    """Zenoh cannot be used as asked: endpoint taken, nobody at the other end, a broken configuration file."""


def configuration(
    listen: Iterable[str] = (), connect: Iterable[str] = (), zenoh_config: Path | None = None
) -> zenoh.Config:
    """The session's configuration: hub (router) where it listens, client where it only connects.

    The rest as in `gameopt_wire.transport`. A user's own file is taken as it is; endpoints given replace its own.
    """
    listen, connect = list(listen), list(connect)
    if zenoh_config is not None:
        try:
            config = zenoh.Config.from_file(str(zenoh_config))
        except zenoh.ZError as error:
            raise BusError(f"{zenoh_config}: {_reason(error)}") from None
        replaced = [(f"{name}/endpoints", given) for name, given in _named(listen, connect) if given]
    else:
        config = zenoh.Config()
        config.insert_json5("mode", json.dumps("router" if listen or not connect else "client"))
        for key, value in transport.SETTINGS.items():
            config.insert_json5(key, value)
        replaced = [(f"{name}/endpoints", given) for name, given in _named(listen, connect)]
    for key, given in replaced:
        try:
            config.insert_json5(key, json.dumps(given))
        except zenoh.ZError as error:
            raise BusError(f"{' '.join(given)}: not a Zenoh endpoint: {_reason(error)}") from None
    return config


def endpoints(config: zenoh.Config) -> list[str]:
    """Where the session is found: what it listens at, or connects to as a client."""
    mode = json.loads(config.get_json("mode")) or "peer"
    found = json.loads(config.get_json(f"{'connect' if mode == 'client' else 'listen'}/endpoints"))
    return list(found.get(mode, []) if isinstance(found, dict) else found)


def _named(listen: list[str], connect: list[str]) -> list[tuple[str, list[str]]]:
    return [("listen", listen), ("connect", connect)]


def _reason(error: Exception) -> str:
    """Zenoh's reason in one line: what the system said if it did, never source files of its build."""
    text = " ".join(str(error).split())
    system = _OS_ERROR.search(text)
    return os.strerror(int(system[1])) if system else re.sub(r"\s+at /\S+", "", text).rstrip(" .")


class Bus:
    """One open session for one intersection; use as an async context manager, which always closes it."""

    def __init__(self, intersection: str, loop: asyncio.AbstractEventLoop, lossless: bool) -> None:
        self.overflow = 0
        self.closed_s = 0.0
        """When the last `drain` had all it had waited for, on the clock of `time.perf_counter`.

        That is when the last state of the roll came, or the drain itself where one was missing or none was called.
        """
        self._intersection = intersection
        self._loop = loop
        self._queue: deque[Raw] = deque()
        self._queued_bytes = 0  # two threads may add at once: near enough, until the next drain
        self._arrived = asyncio.Event()
        self._woken = False
        self._roll_call = RollCall(loop)
        self._session: zenoh.Session | None = None
        self._declared: list[object] = []  # a token that nobody holds is withdrawn
        # Lock-step counts on every message; under the wall clock a blocked loop is worse than a lost one.
        self._congestion = zenoh.CongestionControl.BLOCK if lossless else zenoh.CongestionControl.DROP
        self._counts = lossless
        self._publishers: dict[str, zenoh.Publisher] = {}  # of commands: a key that is put to without is matched anew

    @classmethod
    async def open(cls, intersection: str, config: zenoh.Config, charter: bytes, lossless: bool = False) -> Bus:
        """`connect` and `announce` in one. Raises `BusError`."""
        bus = await cls.connect(intersection, config, lossless)
        try:
            await bus.announce(charter)
        except BaseException:
            await bus.close()
            raise
        return bus

    @classmethod
    async def connect(cls, intersection: str, config: zenoh.Config, lossless: bool = False) -> Bus:
        """Opens the session, and takes its endpoints; nobody sees a manager there before `announce`.

        Raises `BusError`.
        """
        bus = cls(intersection, asyncio.get_running_loop(), lossless)
        try:
            # Opening a router takes half a second, and the loop has better to do.
            await asyncio.to_thread(bus._connect, config)
        except BaseException:
            await bus.close()
            raise
        return bus

    async def announce(self, charter: bytes) -> None:
        """Declares everything, from now on messages are held; `charter` answers queries of the map.

        Raises `BusError`.
        """
        await asyncio.to_thread(self._announce, charter)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the session: a session left open with a callback hangs the interpreter's exit."""
        session, self._session = self._session, None
        self._publishers.clear()
        if session is not None:
            await asyncio.to_thread(session.close)

    def _connect(self, config: zenoh.Config) -> None:
        try:
            session = self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise BusError(_cannot_open(config, error)) from None
        self._refuse_a_second(session)

    def _refuse_a_second(self, session: zenoh.Session) -> None:
        here = self._intersection
        for _ in session.liveliness().get(keys.alive(here, MANAGER), timeout=PROBE_S):
            raise BusError(f"intersection {here}: a manager is already running on this network")

    def _announce(self, charter: bytes) -> None:
        session = self._session
        if session is None:
            return  # closed meanwhile
        self._refuse_a_second(session)  # again: one may have come since
        here, liveliness = self._intersection, session.liveliness()
        alive, map_key = keys.alive(here, MANAGER), keys.intersection_map(here)
        self._declared = [
            session.declare_subscriber(keys.of_all(here, "state"), self._callback("state")),
            session.declare_subscriber(keys.of_all(here, "bid"), self._callback("bid")),
            session.declare_subscriber(keys.step(here), self._callback("step")),
            liveliness.declare_subscriber(keys.alive(here, "") + "*", self._liveliness),
            session.declare_queryable(map_key, partial(_answer, map_key, charter)),
            liveliness.declare_token(alive),  # last: who sees it can ask and be heard
        ]

    def _callback(self, kind: Kind) -> Callable[[zenoh.Sample], None]:
        def received(sample: zenoh.Sample) -> None:
            payload = sample.payload
            # One byte over the limit is enough to be rejected as oversized.
            content = payload.to_bytes()[: codec.MAX_BYTES + 1]
            step = None
            if self._counts:
                mark = sample.attachment
                step = codec.marked_step(mark.to_bytes()) if mark is not None else -1
            key = str(sample.key_expr)
            self._append(Raw(kind, content, key, step))
            if kind == "state":
                self._roll_call.heard(key)

        return received

    def _liveliness(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            key = str(sample.key_expr)
            self._append(Raw("gone", b"", key))
            self._roll_call.gone(keys.of_vehicle(self._intersection, "state", keys.vehicle_of(key)))

    def _append(self, raw: Raw) -> None:
        if len(self._queue) >= MAX_QUEUED or self._queued_bytes >= MAX_QUEUED_BYTES:
            self.overflow += 1
            return
        self._queued_bytes += len(raw.payload) + len(raw.key)
        self._queue.append(raw)
        if not self._woken:
            self._woken = True
            self._loop.call_soon_threadsafe(self._arrived.set)

    def drain(self) -> list[Raw]:
        """All messages since the last call, in the order they came."""
        ended_s = self._roll_call.ended_s
        self.closed_s = time.perf_counter() if ended_s is None else ended_s
        self._arrived.clear()
        self._woken = False  # before the queue is emptied, so that a message coming now wakes the loop again
        queue, self._queued_bytes = self._queue, 0
        return [queue.popleft() for _ in range(len(queue))]

    async def arrival(self) -> None:
        """Returns once there is something to drain."""
        await self._arrived.wait()

    def call_roll(self, whom: Collection[str], since_s: float) -> None:
        """From now on waits for states under these keys, from `since_s` of the epoch, or for their vehicles to go."""
        self._roll_call.begin(whom, since_s)

    async def all_heard(self, most_s: float) -> bool:
        """Returns once everybody called has been heard or is gone, or False after `most_s`."""
        return await self._roll_call.complete(most_s)

    def publish_commands(self, commands: Iterable[Command]) -> None:
        """Sends every command to its vehicle."""
        for command in commands:
            payload, publisher = codec.COMMAND.encode(command), self._publishers.get(command.vehicle)
            if publisher is not None:
                publisher.put(payload)
            else:
                self._put(keys.of_vehicle(self._intersection, "command", command.vehicle), payload)

    def publish_cycle(self, report: CycleReport) -> None:
        """Sends the report of a control cycle."""
        self._put(keys.cycle(self._intersection), codec.CYCLE.encode(report))

    def publish_ledger(self, entry: LedgerEntry) -> None:
        """Says what a vehicle paid."""
        self._put(keys.of_vehicle(self._intersection, "ledger", entry.vehicle), codec.LEDGER.encode(entry))

    def cycle_done(self, vehicles: Collection[str]) -> None:
        """The commands are out: have a publisher for each of the vehicles there are, and for nobody who has gone."""
        if self._session is None:
            return
        present, known = set(vehicles), self._publishers.keys()
        for vehicle in [*islice(known - present, DECLARED_AT_ONCE)]:
            self._publishers.pop(vehicle).undeclare()  # type: ignore[no-untyped-call]
        for vehicle in [*islice(present - known, DECLARED_AT_ONCE)]:
            key = keys.of_vehicle(self._intersection, "command", vehicle)
            self._publishers[vehicle] = self._session.declare_publisher(key, congestion_control=self._congestion)

    def _put(self, key: str, payload: bytes) -> None:
        if self._session is not None:
            self._session.put(key, payload, congestion_control=self._congestion)


def _answer(key: str, charter: bytes, query: zenoh.Query) -> None:
    query.reply(key, charter)


def _cannot_open(config: zenoh.Config, error: Exception) -> str:
    """Which endpoint it was, as far as Zenoh says, and why."""
    asked = re.findall(r'"([^"]*/[^"]*)"', config.get_json("listen/endpoints"))
    asked += re.findall(r'"([^"]*/[^"]*)"', config.get_json("connect/endpoints"))
    named = [endpoint for endpoint in asked if endpoint in str(error)]
    reason = "nobody listens there" if "Unable to connect" in str(error) else _reason(error)
    return f"{' '.join(named or asked)}: {reason}"
