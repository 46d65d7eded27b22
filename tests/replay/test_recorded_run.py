"""A recording of the real manager, run again by the real command."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from gameopt_im import cli
from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters, Service
from gameopt_im.inbox import Raw
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.recorder import RecordedCycle, Recorder
from gameopt_im.service import charter_of, solver_of
from gameopt_wire import codec, keys
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Bid, Command, State

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
OPTIONS = ServeOptions(map=ROADS, parameters=Parameters(), clock="lockstep", workers=0)
SPEED_MPS = 12.0
CYCLES = 40


def state(vehicle: str, movement: str, distance_m: float, time_s: float) -> Raw:
    said = State(
        vehicle=vehicle,
        time_s=time_s,
        movement=movement,
        distance_m=distance_m,
        speed_mps=SPEED_MPS,
        acceleration_mps2=0.0,
        length_m=5.0,
        width_m=1.8,
        vehicle_class="passenger",
        max_speed_mps=30.0,
        max_accel_mps2=2.6,
        max_decel_mps2=4.5,
    )
    return Raw("state", codec.STATE.encode(said), keys.of_vehicle(ROADS.intersection, "state", vehicle))


def spoken(cycle: int) -> list[Raw]:
    """Two vehicles on crossing lanes, and garbage between them."""
    time_s = cycle / 10
    raws = [Raw("state", b"\xc1", keys.of_vehicle(ROADS.intersection, "state", "broken"))]
    for vehicle, movement, start_m in (("a", "0-1", 110.0), ("b/1", "2-1", 105.0)):
        raws.append(state(vehicle, movement, start_m - SPEED_MPS * time_s, time_s))
        bid = Bid(vehicle=vehicle, time_s=time_s, assertiveness=4.0)
        raws.append(Raw("bid", codec.BID.encode(bid), keys.of_vehicle(ROADS.intersection, "bid", vehicle)))
    return raws


async def driven(ahead: int = 0) -> list[RecordedCycle]:
    """Time runs, and begins anew half way; so many messages of each control cycle are read before it."""
    run = []
    async with solver_of(OPTIONS) as pool:
        manager = Manager(OPTIONS, 7, pool)
        for number in range(2 * CYCLES):
            cycle = number % CYCLES + 1
            restarted = number == CYCLES
            if restarted:
                manager.restart()
            tick = Tick(cycle, cycle / 10, spoken(cycle), restarted, ahead=ahead)
            manager.read_ahead(tick.messages[:ahead], tick.time_s)
            outcome = await manager.control_cycle(tick.cycle, tick.time_s, tick.messages)
            run.append(RecordedCycle(tick, outcome.commands))
    return run


@pytest.mark.parametrize("ahead", [1, 3, 4])
def test_it_makes_no_difference_whether_messages_are_read_ahead(tmp_path: Path, ahead: int) -> None:
    run = asyncio.run(driven(ahead))
    assert [each.commands for each in run] == [each.commands for each in asyncio.run(driven())]
    assert cli.run(("replay", str(recorded(tmp_path / "run.mcap", run)))) == 0


def test_a_flood_of_which_some_was_read_ahead_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Which of the made-up vehicles are heard depends on how many were before there were too many."""
    parameters = Parameters(
        service=Service(max_vehicles=3), program=msgspec.structs.replace(Parameters().program, solve=False)
    )
    options = replace(OPTIONS, clock="wall", parameters=parameters)
    flood = [state(f"made up {k}", "0-1", 100.0 - 10.0 * k, 0.1) for k in range(8)]

    async def driven() -> tuple[Tick, list[Command]]:
        async with solver_of(options) as pool:
            manager = Manager(options, 7, pool)
            ahead = sum(manager.read_ahead(piece, 0.1) for piece in (flood[:4], flood[4:]))
            outcome = await manager.control_cycle(1, 0.1, flood)
            return Tick(1, 0.1, flood, ahead=ahead), outcome.commands

    tick, commands = asyncio.run(driven())
    assert tick.ahead == 4
    assert commands
    path = tmp_path / "run.mcap"
    assert cli.run(("replay", str(recorded(path, [RecordedCycle(tick, commands)], options)))) == 0
    at_once = RecordedCycle(tick._replace(ahead=8), commands)
    assert cli.run(("replay", str(recorded(path, [at_once], options)))) == 1
    assert "vehicle made up " in capsys.readouterr().out


def recorded(path: Path, run: list[RecordedCycle], options: ServeOptions = OPTIONS) -> Path:
    with Recorder(path, charter_of(options, 7), options.parameters, ("serve",)) as recorder:
        for each in run:
            recorder.record(each.tick, each.commands)
    return path


def test_a_recorded_run_comes_out_the_same_and_a_changed_one_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = asyncio.run(driven())
    assert all(len(each.commands) == 2 for each in run)
    assert any(command.clearance is not None for each in run for command in each.commands)
    path = recorded(tmp_path / "run.mcap", run)
    capsys.readouterr()
    assert cli.run(("replay", str(path))) == 0
    assert capsys.readouterr().out == f"{2 * CYCLES} control cycles, every command as recorded\n"

    command = run[9].commands[1]
    faster = msgspec.structs.replace(command, speed_mps=command.speed_mps + 1e-9)
    run[9] = RecordedCycle(run[9].tick, [run[9].commands[0], faster])
    assert cli.run(("replay", str(recorded(path, run)))) == 1
    said = capsys.readouterr().out
    assert said.startswith(f"control cycle 10, vehicle {command.vehicle}, speed_mps: recorded ")
