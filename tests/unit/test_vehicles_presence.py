"""Tokens of many vehicles on sessions that relieve each other, against a hub in the same process."""

from __future__ import annotations

import asyncio
import queue
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import NamedTuple

import pytest
import zenoh

from gameopt_vehicles.bus import Bus, configuration
from gameopt_vehicles.presence import Presence
from gameopt_wire import keys

HERE = "cross/roads"
PATIENCE_S = 10.0
"""Nothing takes this long; a test that would otherwise hang fails instead."""


class Hub(NamedTuple):
    """Where the vehicles connect to, and which tokens have come and gone there."""

    endpoint: str
    seen: queue.Queue[tuple[zenoh.SampleKind, str]]

    async def next_seen(self) -> tuple[zenoh.SampleKind, str]:
        return await asyncio.to_thread(self.seen.get, timeout=PATIENCE_S)


@pytest.fixture
def hub() -> Iterator[Hub]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    config = configuration((), None)
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    seen: queue.Queue[tuple[zenoh.SampleKind, str]] = queue.Queue()
    with zenoh.open(config) as session:
        session.liveliness().declare_subscriber(
            keys.alive(HERE, "") + "*", lambda sample: seen.put((sample.kind, keys.vehicle_of(str(sample.key_expr))))
        )
        yield Hub(endpoint, seen)


class Sessions:
    """Opens sessions to the hub, and closes what is left of them."""

    def __init__(self, endpoint: str, stack: ExitStack) -> None:
        self.opened: list[zenoh.Session] = []
        self._endpoint, self._stack = endpoint, stack

    def another(self) -> zenoh.Session:
        self.opened.append(self._stack.enter_context(zenoh.open(configuration((self._endpoint,), None))))
        return self.opened[-1]


async def relieved(presence: Presence) -> None:
    if presence._relief is not None:  # it may be over already
        await presence._relief


def test_a_session_that_has_declared_enough_is_relieved_and_closed_with_its_last_vehicle(
    hub: Hub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gameopt_vehicles.presence.TOKENS_A_SESSION", 2)
    came, went = zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE

    async def work(sessions: Sessions) -> None:
        owners = sessions.another()
        presence = Presence(owners, sessions.another)

        async def announced(*vehicles: str) -> None:
            for vehicle in vehicles:
                presence.announce(HERE, vehicle)
                assert await hub.next_seen() == (came, vehicle)

        async def withdrawn(vehicle: str) -> None:
            presence.withdraw(vehicle)
            assert await hub.next_seen() == (went, vehicle)
            await asyncio.gather(*presence._closing)

        await announced("a", "b")
        await relieved(presence)
        await announced("c", "d")
        await relieved(presence)
        await announced("e")
        assert len(sessions.opened) == 3
        await withdrawn("c")
        assert not any(session.is_closed() for session in sessions.opened)
        await withdrawn("d")
        assert [session.is_closed() for session in sessions.opened] == [False, True, False]
        await withdrawn("b")
        await withdrawn("a")
        assert not owners.is_closed()  # not ours to close
        await withdrawn("e")
        assert not sessions.opened[2].is_closed()  # the next vehicle's
        await announced("f")
        await presence.close()  # while the next session is being opened
        assert await hub.next_seen() == (went, "f")
        assert [session.is_closed() for session in sessions.opened] == [False, True, True, True]

    with ExitStack() as stack:
        asyncio.run(work(Sessions(hub.endpoint, stack)), debug=True)


def test_where_no_other_session_can_be_had_the_first_goes_on(hub: Hub, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gameopt_vehicles.presence.TOKENS_A_SESSION", 2)
    asked = []

    def refused() -> zenoh.Session:
        asked.append(1)
        raise zenoh.ZError("no more of them")

    async def work(sessions: Sessions) -> None:
        presence = Presence(sessions.another(), refused)
        for k in range(6):
            presence.announce(HERE, f"v{k}")
            assert await hub.next_seen() == (zenoh.SampleKind.PUT, f"v{k}")
            if k % 2:
                await relieved(presence)
        assert len(asked) == 3
        presence.withdraw("v0")
        assert await hub.next_seen() == (zenoh.SampleKind.DELETE, "v0")
        await presence.close()

    with ExitStack() as stack:
        asyncio.run(work(Sessions(hub.endpoint, stack)), debug=True)


@pytest.mark.parametrize(("mode", "several"), [("client", True), ("peer", False)])
def test_the_bus_relieves_its_session_as_a_client_and_not_where_it_may_listen(
    hub: Hub, monkeypatch: pytest.MonkeyPatch, mode: str, several: bool
) -> None:
    monkeypatch.setattr("gameopt_vehicles.presence.TOKENS_A_SESSION", 2)

    async def work() -> None:
        config = configuration((hub.endpoint,), None)
        config.insert_json5("mode", f'"{mode}"')
        async with await Bus.open(config, reliable=False) as bus:
            bus.intersection = HERE
            for vehicle in ("a", "b"):
                bus.announce(vehicle)
            await relieved(bus._present)
            assert bool(bus._present._opened) == several
            bus.announce("c")
            assert [await hub.next_seen() for _ in range(3)] == [(zenoh.SampleKind.PUT, each) for each in "abc"]

    asyncio.run(work(), debug=True)
