"""The fleet against a real Zenoh session that answers as a manager does."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import pytest
import zenoh
from stand_in import MAP, StandIn, run

from gameopt_vehicles.bus import Bus, NoManager, configuration
from gameopt_vehicles.fleet import Fleet, Settings
from gameopt_vehicles.synthetic import SyntheticRoad
from gameopt_wire import codec, keys

pytestmark = pytest.mark.processes


async def drive(manager: StandIn, present: int = 12, **settings: Any) -> Fleet:
    """A fleet on the synthetic road, run to its end."""
    config = configuration((manager.endpoint,), None)
    chosen = Settings(**({"clock": manager.charter.clock, "duration_s": 12.0} | settings))
    async with await Bus.open(config, reliable=chosen.clock == "lockstep") as bus:
        charter = await bus.charter(None)
        bus.join(charter.map.intersection)
        fleet = Fleet(SyntheticRoad(charter.map, present, chosen.seed), bus, chosen)
        await fleet.run()
    return fleet


def test_lockstep_drives_vehicles_across() -> None:
    async def scenario() -> None:
        async with StandIn() as manager:
            fleet = await drive(manager)
        assert len(fleet.tally.elapsed_ms) == 120
        assert fleet.tally.sent == len(manager.states) + len(manager.bids)
        assert fleet.tally.received == len(manager.states)
        assert fleet.tally.totals["qp_solved_total"] == 119  # the first report is where counting starts
        assert (fleet.lost, fleet.tally.rejected, fleet.tally.fallbacks) == (0, 0, 0)
        past = {state.vehicle for state in manager.states if state.distance_m < 0.0}
        assert len(past) >= 6
        accepted = [state for state in manager.states if state.accepted is not None]
        assert {state.term for state in accepted} == {7}
        assert all(manager.offers[state.vehicle] == state.accepted for state in accepted)

    run(scenario)


def test_lockstep_repeats_bit_for_bit_also_with_faults() -> None:
    async def traffic() -> list[bytes]:
        async with StandIn() as manager:
            await drive(manager, loss=0.2, delay_s=0.1, jitter_s=0.1, tracking_noise_mps=0.05, seed=3)
        return sorted(manager.traffic)

    runs: list[list[bytes]] = []

    async def scenario() -> None:
        runs.append(await traffic())
        runs.append(await traffic())

    run(scenario)
    assert runs[0] == runs[1]
    assert len(runs[0]) > 500


def test_faults_lose_messages_and_vehicles_fall_back() -> None:
    async def scenario() -> None:
        async with StandIn() as manager:
            fleet = await drive(manager, loss=1.0)
        assert manager.states == []
        assert fleet.tally.sent == 0
        assert fleet.lost > 1000
        assert fleet.tally.fallbacks >= 12

    run(scenario)


def test_wall_clock_steps_on_the_grid_and_shows_who_is_there() -> None:
    async def scenario() -> None:
        async with StandIn(clock="wall") as manager:
            began_s = time.time()
            fleet = await drive(manager, duration_s=3.0)
            took_s = time.time() - began_s
        assert took_s == pytest.approx(3.0, abs=0.5)
        assert fleet.tally.received > 200
        times = sorted({state.time_s for state in manager.states})
        assert all(state_s == round(state_s * 10) / 10 for state_s in times)
        assert (zenoh.SampleKind.PUT, manager.states[0].vehicle) in manager.tokens
        assert any(state.accepted is not None for state in manager.states)

    run(scenario)


def test_no_message_ever_contains_the_private_preference() -> None:
    async def scenario() -> None:
        async with StandIn() as manager:
            road = SyntheticRoad(MAP, 12, 1)
            config = configuration((manager.endpoint,), None)
            async with await Bus.open(config, reliable=True) as bus:
                bus.join(MAP.intersection)
                fleet = Fleet(road, bus, Settings(duration_s=3.0))
                await fleet.run()
            secrets = [member.agent._preference.aggressiveness for member in fleet._members.values()]
        captured = b"".join(manager.traffic)
        assert len(secrets) >= 10
        assert len(manager.bids) >= 10
        for secret in secrets:
            assert msgspec.msgpack.encode(secret)[1:] not in captured
            assert repr(secret).encode() not in captured

    run(scenario)


def test_a_class_bids_by_the_aggressiveness_given_to_it() -> None:
    async def scenario() -> None:
        async with StandIn() as manager:
            await drive(manager, present=30, duration_s=3.0, aggressiveness={"passenger": 0.75})
        classes = {state.vehicle: state.vehicle_class for state in manager.states}
        cars = {bid.assertiveness for bid in manager.bids if classes[bid.vehicle] == "passenger"}
        others = {bid.assertiveness for bid in manager.bids if classes[bid.vehicle] != "passenger"}
        assert cars == {4.0}
        assert len(others) > 1, "who is not named has a preference of its own"

    run(scenario)


def test_a_silent_manager_ends_the_lockstep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gameopt_vehicles.fleet.SILENCE_S", 0.3)

    async def scenario() -> None:
        # On the wall clock its reports carry other cycles than the step asks for: talk, but no answer.
        async with StandIn(clock="wall") as manager:
            with pytest.raises(NoManager, match="stopped answering"):
                await drive(manager, clock="lockstep")

    run(scenario)


def test_several_managers_need_a_name() -> None:
    async def scenario() -> None:
        other = msgspec.structs.replace(MAP, intersection="other")
        async with StandIn() as manager:
            answer = codec.CHARTER.encode(msgspec.structs.replace(manager.charter, map=other, digest=other.digest()))
            key = keys.intersection_map("other")
            second = manager._session.declare_queryable(key, lambda query: query.reply(key, answer))
            async with await Bus.open(configuration((manager.endpoint,), None), reliable=True) as bus:
                with pytest.raises(NoManager, match=r"main/1, other.*--junction"):
                    await bus.charter(None)
                assert (await bus.charter("other")).map.intersection == "other"
            second.undeclare()

    run(scenario)
