"""The vehicles' side of Zenoh: one client session for all of them, and others for their liveliness tokens.

Zenoh calls back on its own threads. A callback only appends bytes to a deque and wakes the event loop, once
for however many messages have arrived since; everything else happens on the loop.
"""

from __future__ import annotations

import asyncio
import json
import re
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import zenoh

from gameopt_vehicles.presence import Presence
from gameopt_wire import codec, keys, transport
from gameopt_wire.intersection import Charter

ANSWER_TIMEOUT_S = 2.5
"""How long to wait for a connection, then for the manager's answer on it."""
ASK_AGAIN_S = 0.1
"""A manager that is just starting has not declared its map yet: no answer, at once. Ask again."""


class NoManager(Exception):  # noqa: N818 - what the user is told
    """No manager answers, it stopped answering, or it runs on another map or clock than the vehicles."""


class BadBusConfiguration(ValueError):  # noqa: N818
    """An endpoint or a Zenoh configuration file that cannot be used."""


def configuration(endpoints: tuple[str, ...], file: Path | None) -> zenoh.Config:
    """A client session to `endpoints`; or what `file` says, with `endpoints` in place of its own if any."""
    try:
        config = zenoh.Config.from_file(str(file)) if file else zenoh.Config()
    except zenoh.ZError as error:
        raise BadBusConfiguration(f"{file}: {_one_line(error)}") from None
    settings: dict[str, str] = {}
    if file is None:
        settings |= {"mode": '"client"', **transport.SETTINGS}
        # The manager may be starting at this moment; without a timeout the first refusal would be final.
        settings["connect/timeout_ms"] = str(int(ANSWER_TIMEOUT_S * 1000))
    if endpoints:
        settings["connect/endpoints"] = json.dumps(endpoints)
    for key, value in settings.items():
        try:
            config.insert_json5(key, value)
        except zenoh.ZError as error:
            raise BadBusConfiguration(f"{value} for {key} is refused by Zenoh: {_one_line(error)}") from None
    return config


class Received(NamedTuple):
    """A message, and when it came, on the monotonic clock."""

    at_s: float
    payload: bytes


class Bus:
    """An open session; use it as an asynchronous context, so that it is closed whatever happens."""

    def __init__(self, session: zenoh.Session, presence: Presence, where: str, *, reliable: bool) -> None:
        self._session = session
        self._present = presence
        self._where = where
        self._loop = asyncio.get_running_loop()
        self._awake = asyncio.Event()
        self._wake_pending = False
        self._subscribers: list[zenoh.Subscriber[None]] = []
        # In lock-step a dropped message would stall both sides; under the wall clock a late one is worthless.
        self._congestion = zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP
        self.intersection = ""
        self.commands: deque[Received] = deque()
        self.reports: deque[Received] = deque()
        self.presence: deque[bool] = deque()

    @classmethod
    async def open(cls, config: zenoh.Config, *, reliable: bool) -> Self:
        """Connect; raises `NoManager` when nobody listens."""
        where = ", ".join(_endpoints(config)) or "the Zenoh network"
        try:
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            if "Unable to connect" in str(error):
                raise NoManager(f"no manager listens on {where}") from None
            raise NoManager(f"no connection to {where}: {_one_line(error)}") from None
        # Only a client can have a second session of the same configuration: others may listen, at a port of theirs.
        several = json.loads(config.get_json("mode")) == "client"
        presence = Presence(session, partial(zenoh.open, config) if several else None)
        return cls(session, presence, where, reliable=reliable)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            await self._present.close()
        finally:
            await asyncio.to_thread(self._session.close)

    async def charter(self, intersection: str | None) -> Charter:
        """The manager's answer for its map; `None` asks whoever is there, which must be a single one."""
        key = keys.intersection_map(intersection) if intersection else f"{keys.ROOT}/*/map"
        about = f"intersection {intersection!r}" if intersection else "any intersection"
        deadline_s = self._loop.time() + ANSWER_TIMEOUT_S
        while not (answers := await asyncio.to_thread(self._ask, key)):
            if self._loop.time() >= deadline_s:
                raise NoManager(f"no manager answers for {about} on {self._where}")
            await asyncio.sleep(ASK_AGAIN_S)
        if len(answers) > 1:
            names = ", ".join(sorted(charter.map.intersection for charter in answers))
            raise NoManager(f"several managers answer on {self._where} ({names}); name one with --junction")
        return answers[0]

    def join(self, intersection: str) -> None:
        """Listen to the intersection: commands, control cycle reports, and whether its manager is alive."""
        self.intersection = intersection
        session = self._session
        self._subscribers = [
            session.declare_subscriber(keys.of_all(intersection, "command"), self._into(self.commands)),
            session.declare_subscriber(keys.cycle(intersection), self._into(self.reports)),
            session.liveliness().declare_subscriber(
                keys.alive(intersection, "manager"), self._on_presence, history=True
            ),
        ]

    def put(self, key: str, payload: bytes, mark: bytes | None = None) -> None:
        """Publish one message; `mark` tells a lock-step's messages from strays."""
        self._session.put(key, payload, congestion_control=self._congestion, attachment=mark)

    def announce(self, vehicle: str) -> None:
        """Declare that `vehicle` is there, until `withdraw` or the end of the session."""
        self._present.announce(self.intersection, vehicle)

    def withdraw(self, vehicle: str) -> None:
        """Take the declaration back."""
        self._present.withdraw(vehicle)

    async def wait(self, timeout_s: float) -> bool:
        """Sleep until something has arrived or `timeout_s` have passed; whether something has."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._awake.wait()
        except TimeoutError:
            return False
        self._awake.clear()
        return True

    def wake(self) -> None:
        """End a `wait` early; from the event loop only."""
        self._awake.set()

    def _ask(self, key: str) -> list[Charter]:
        answers = []
        for reply in self._session.get(key, timeout=ANSWER_TIMEOUT_S):
            if reply.ok is None:
                continue
            try:
                answers.append(codec.CHARTER.decode(reply.ok.payload.to_bytes()))
            except codec.Rejected as rejected:
                raise NoManager(f"the manager's map cannot be read: {rejected}") from None
        return answers

    def _into(self, queue: deque[Received]) -> Callable[[zenoh.Sample], None]:
        def arrived(sample: zenoh.Sample) -> None:
            queue.append(Received(time.monotonic(), sample.payload.to_bytes()))
            self._wake_loop()

        return arrived

    def _on_presence(self, sample: zenoh.Sample) -> None:
        self.presence.append(sample.kind == zenoh.SampleKind.PUT)
        self._wake_loop()

    def _wake_loop(self) -> None:
        """Called on Zenoh's threads. A wake-up lost to the race on the flag is one that is still to come."""
        if not self._wake_pending:
            self._wake_pending = True
            self._loop.call_soon_threadsafe(self._woken)

    def _woken(self) -> None:
        self._wake_pending = False
        self._awake.set()


def _endpoints(config: zenoh.Config) -> list[str]:
    """What the configuration connects to, for messages to the user."""
    found = config.get_json("connect/endpoints")
    return [str(endpoint).strip('"[] ') for endpoint in str(found).split(",") if endpoint.strip('"[] ')]


def _one_line(error: Exception) -> str:
    """The library's message without its wrapping and without the path of its own source file."""
    text = " ".join(re.split(r"\s+at /", str(error), maxsplit=1)[0].split())
    return text.rpartition('msg: "')[2].rstrip("!.")
