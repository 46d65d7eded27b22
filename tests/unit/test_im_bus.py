"""The manager's bus against a second Zenoh session in the same process, over a real endpoint."""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
import zenoh
from meeting import CHARTER, HERE, PATIENCE_S, free_endpoint, hub, run

from gameopt_im.bus import Bus, configuration
from gameopt_im.inbox import Raw
from gameopt_wire import codec, keys
from gameopt_wire.messages import Command, LedgerEntry


@asynccontextmanager
async def vehicles(endpoint: str) -> AsyncIterator[zenoh.Session]:
    session = await asyncio.to_thread(zenoh.open, configuration(connect=[endpoint]))
    try:
        yield session
    finally:
        await asyncio.to_thread(session.close)


async def ask_map(session: zenoh.Session) -> list[bytes]:
    """The answers to a query of the map; with them, the hub has seen all that was declared before."""

    def ask() -> list[bytes]:
        replies = session.get(keys.intersection_map(HERE), timeout=PATIENCE_S)
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    return await asyncio.to_thread(ask)


async def gather(bus: Bus, count: int) -> list[Raw]:
    messages: list[Raw] = []
    while len(messages) < count:
        await bus.arrival()
        messages += bus.drain()
    return messages


def test_the_map_query_is_answered_with_the_charter() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint), vehicles(endpoint) as session:
            assert await ask_map(session) == [CHARTER]

    run(work())


def test_states_bids_and_steps_are_handed_over_as_they_came() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        sent = {
            Raw("state", b"\x00state", keys.of_vehicle(HERE, "state", "car/1*")),
            Raw("bid", b"bid", keys.of_vehicle(HERE, "bid", "car/1*")),
            Raw("step", b"step", keys.step(HERE)),
        }
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            for raw in sent:
                session.put(raw.key, raw.payload)
            session.put(keys.of_vehicle("elsewhere", "state", "a"), b"not ours")
            assert set(await gather(bus, 3)) == sent
            assert bus.drain() == []

    run(work())


def test_messages_of_one_kind_keep_their_order() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            key = keys.of_vehicle(HERE, "state", "a")
            block = zenoh.CongestionControl.BLOCK
            for index in range(2000):
                session.put(key, str(index).encode(), congestion_control=block)
            messages = await gather(bus, 2000)
            assert [int(raw.payload) for raw in messages] == list(range(2000))

    run(work())


def test_a_roll_call_ends_with_the_last_one_awaited_whether_heard_or_gone() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        here, leaving, silent = (keys.of_vehicle(HERE, "state", name) for name in ("here/1", "leaving/1", "silent"))
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            token = session.liveliness().declare_token(keys.alive(HERE, "leaving/1"))
            await ask_map(session)
            bus.call_roll({here}, time.time() + PATIENCE_S)
            session.put(here, b"too early")
            await gather(bus, 1)
            assert not await bus.all_heard(0.0)
            bus.call_roll({here, leaving}, time.time())
            both = asyncio.create_task(bus.all_heard(PATIENCE_S))
            session.put(here, b"state")
            session.put(here, b"again")
            session.put(silent, b"nobody waits for it")
            await gather(bus, 3)
            assert not both.done()
            asked_s = time.perf_counter()
            bus.drain()
            assert bus.closed_s >= asked_s  # one is missing: the wait ends with the drain
            await asyncio.to_thread(token.undeclare)
            assert await both
            heard_s = time.perf_counter()
            bus.drain()
            assert asked_s < bus.closed_s < heard_s  # when the last one was heard, not when it was drained
            bus.call_roll({silent}, time.time())
            assert not await bus.all_heard(0.01)

    run(work())


def test_an_oversized_message_is_cut_to_what_is_rejected_anyway() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            session.put(keys.of_vehicle(HERE, "state", "a"), b"x" * 1_000_000)
            (raw,) = await gather(bus, 1)
            with pytest.raises(codec.Rejected, match="oversized"):
                codec.STATE.decode(raw.payload)
            assert len(raw.payload) == codec.MAX_BYTES + 1

    run(work())


def test_a_vehicle_whose_token_vanishes_is_gone() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus:
            async with vehicles(endpoint) as session:
                leaving = session.liveliness().declare_token(keys.alive(HERE, "leaving/1"))
                cut_off = session.liveliness().declare_token(keys.alive(HERE, "cut off"))
                await ask_map(session)
                assert bus.drain() == []
                await asyncio.to_thread(leaving.undeclare)
                assert await gather(bus, 1) == [Raw("gone", b"", keys.alive(HERE, "leaving/1"))]
            assert await gather(bus, 1) == [Raw("gone", b"", keys.alive(HERE, "cut off"))]
            del cut_off  # held until here: a token that nobody holds is withdrawn

    run(work())


def test_commands_and_ledger_entries_reach_their_vehicle_and_the_manager_is_alive() -> None:
    command = Command(vehicle="car/1", term=1, cycle=2, time_s=0.2, speed_mps=9.0, valid_until_s=0.7)
    entry = LedgerEntry(vehicle="car/1", term=1, entered_s=0.1, cleared_s=0.2, price=0.5, bid=0.75)

    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            heard: queue.Queue[tuple[str, bytes]] = queue.Queue()
            presence: queue.Queue[zenoh.SampleKind] = queue.Queue()
            for stream in ("command", "ledger"):
                session.declare_subscriber(
                    f"{keys.ROOT}/{keys.encode(HERE)}/{stream}/*",
                    lambda sample: heard.put((str(sample.key_expr), sample.payload.to_bytes())),
                )
            session.liveliness().declare_subscriber(
                keys.alive(HERE, "manager"), lambda sample: presence.put(sample.kind), history=True
            )
            await ask_map(session)
            bus.publish_commands([command])
            bus.publish_ledger(entry)
            received = {await asyncio.to_thread(heard.get, timeout=PATIENCE_S) for _ in range(2)}
            assert received == {
                (keys.of_vehicle(HERE, "command", "car/1"), codec.COMMAND.encode(command)),
                (keys.of_vehicle(HERE, "ledger", "car/1"), codec.LEDGER.encode(entry)),
            }
            assert await asyncio.to_thread(presence.get, timeout=PATIENCE_S) == zenoh.SampleKind.PUT
            await bus.close()
            assert await asyncio.to_thread(presence.get, timeout=PATIENCE_S) == zenoh.SampleKind.DELETE

    run(work())


def test_what_is_held_is_bounded_in_bytes_too_and_what_is_dropped_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gameopt_im.bus.MAX_QUEUED_BYTES", 1_000)

    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            last = keys.of_vehicle(HERE, "state", "last")
            for dropped in (3, 6):  # the second time, too: what has been drained is held no longer
                bus.call_roll({last}, since_s=0.0)  # heard though dropped: whatever came before has been handed over
                for key in [keys.of_vehicle(HERE, "state", "a")] * 5 + [last]:
                    session.put(key, b"x" * 400)
                assert await bus.all_heard(PATIENCE_S)
                assert len(bus.drain()) == 3
                assert bus.overflow == dropped

    run(work())


def test_a_reader_that_stands_still_for_a_control_cycle_misses_no_command() -> None:
    commands = [
        Command(
            vehicle=f"car {k}", term=1_764_201_000_123, cycle=17_957_377_523, time_s=1_795_737_752.3,
            speed_mps=9.1234567, valid_until_s=1_795_737_752.8,
        )
        for k in range(1_500)
    ]  # fmt: skip
    goes_on, came = threading.Event(), queue.Queue[str]()

    def reads(sample: zenoh.Sample) -> None:
        assert goes_on.wait(PATIENCE_S)
        came.put(str(sample.key_expr))

    async def work() -> None:
        endpoint = f"{free_endpoint()}#so_sndbuf=8192;so_rcvbuf=8192"  # the system holds next to nothing for it
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            session.declare_subscriber(keys.of_all(HERE, "command"), reads)
            await ask_map(session)
            bus.publish_commands(commands)
            goes_on.set()
            received = [await asyncio.to_thread(came.get, timeout=PATIENCE_S) for _ in commands]
            assert received == [keys.of_vehicle(HERE, "command", each.vehicle) for each in commands]

    run(work())


def test_a_vehicle_has_a_publisher_for_as_long_as_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gameopt_im.bus.DECLARED_AT_ONCE", 2)

    def command(vehicle: str) -> Command:
        return Command(vehicle=vehicle, term=1, cycle=2, time_s=0.2, speed_mps=9.0, valid_until_s=0.7)

    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint) as bus, vehicles(endpoint) as session:
            heard: queue.Queue[bytes] = queue.Queue()
            command_keys = keys.of_all(HERE, "command")
            session.declare_subscriber(command_keys, lambda sample: heard.put(sample.payload.to_bytes()))
            await ask_map(session)
            for k in range(100):
                commands = [command(f"car {k}"), command(f"car {k + 1}"), command(f"car {k + 2}")]
                bus.publish_commands(commands)  # the last one is new
                bus.cycle_done([each.vehicle for each in commands])
                received = [await asyncio.to_thread(heard.get, timeout=PATIENCE_S) for _ in commands]
                assert received == [codec.COMMAND.encode(each) for each in commands]
            assert set(bus._publishers) == {"car 99", "car 100", "car 101"}
            bus.cycle_done([])
            assert len(bus._publishers) == 1  # only so many at once
            bus.cycle_done([])
            assert not bus._publishers
            await bus.close()
            bus.publish_commands([command("car 1")])  # to nobody: it is closed
            bus.cycle_done(["car 1"])
            assert not bus._publishers

    run(work())
