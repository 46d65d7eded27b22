"""More than there is time or room for: the manager's process still commands everybody it answers for, every cycle."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from closed_loop import in_a_process
from processes import Observer, Running, command, free_endpoint, manager, run

from gameopt_im.core.parameters import Parameters
from gameopt_sumo.network import packaged_map
from gameopt_sumo.scenarios import FourArm, write_four_arm
from gameopt_wire import codec, keys
from gameopt_wire.messages import State

pytestmark = pytest.mark.processes

PRESENT = 60
SHORT_OF_TIME = "[service]\nbudget_s = 0.001\n"
JUNK, MADE_UP = 50_000, 50_000
MOST_GROWTH_BYTES = 100 * 2**20
CYCLES_KEY = f"{keys.ROOT}/*/cycle"


def configured(folder: Path, text: str) -> tuple[str, Path]:
    path = folder / "im.toml"
    path.write_text(text)
    return "--config", path


def test_a_manager_short_of_time_drops_candidates_and_commands_everybody_every_cycle(tmp_path: Path) -> None:
    async def scenario() -> None:
        endpoint, file = free_endpoint(), tmp_path / "report.json"
        async with manager(*configured(tmp_path, SHORT_OF_TIME), endpoint=endpoint, clock="wall") as serving:
            async with Observer(endpoint, CYCLES_KEY) as observer:
                drive = ("--synthetic", PRESENT, "--connect", endpoint, "--clock", "wall", "--duration", 8)
                ended = await command("gameopt_vehicles", *drive, "--report", file)
            await serving.said("short of time")
        assert ended.code == 0, ended.err
        reports = [report for report in observer.reports if report.vehicles]
        assert len(reports) > 60
        assert max(report.vehicles for report in reports) >= 0.9 * PRESENT
        assert all(report.commands == report.vehicles - report.silent for report in reports)
        assert max(report.candidates for report in reports) == 1
        report = json.loads(file.read_bytes())
        assert report["control_cycle"]["dropped"] > 100
        assert report["control_cycle"]["unsolved"] > 40
        assert report["vehicles"]["crossed"] > 5

    run(scenario)


def test_vehicles_beyond_those_answered_for_stop_by_themselves_and_harm_nobody(tmp_path: Path) -> None:
    busy = write_four_arm(FourArm(flow_veh_h=6_000.0, seed=104, duration_s=60.0), tmp_path)
    found = in_a_process(sumocfg=str(busy), duration_s=60.0, configuration="[service]\nmax_vehicles = 6")
    assert found["rejected"]["overload"] > 100
    assert found["fallbacks"] > 5
    assert found["safety"]["collisions_sumo"] == found["safety"]["collisions_geometric"] == 0
    assert found["safety"]["teleports"] == 0
    assert found["vehicles"]["crossed"] > 10


def made_up(name: str, movement: str, time_s: float) -> bytes:
    """A valid state of a vehicle that does not exist."""
    return codec.STATE.encode(
        State(
            vehicle=name, time_s=time_s, movement=movement, distance_m=140.0, speed_mps=10.0,
            acceleration_mps2=0.0, length_m=5.0, width_m=1.8, vehicle_class="passenger", max_speed_mps=50.0,
            max_accel_mps2=2.6, max_decel_mps2=4.5,
        )
    )  # fmt: skip


def flood(here: str, time_s: float) -> list[tuple[str, bytes]]:
    """Junk, then states of vehicles that nobody has seen, each under a key of its own."""
    junk = [(keys.of_vehicle(here, "state", f"junk {k}"), b"\xc1" * 1000) for k in range(JUNK)]
    movement = packaged_map().movements[0].id
    names = [f"made up {k}" for k in range(MADE_UP)]
    return junk + [(keys.of_vehicle(here, "state", name), made_up(name, movement, time_s)) for name in names]


def send(observer: Observer, messages: list[tuple[str, bytes]]) -> None:
    """As fast as they go, none dropped."""
    for key, payload in messages:
        observer.put(key, payload)


def resident_bytes(process: int) -> int:
    """Memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096


def test_a_flood_of_messages_is_counted_and_takes_neither_memory_nor_control_cycles(tmp_path: Path) -> None:
    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager(endpoint=endpoint, clock="wall"), Observer(endpoint, CYCLES_KEY) as observer:
            charter = codec.CHARTER.decode(await observer.charter())
            drive = ("--synthetic", PRESENT, "--connect", endpoint, "--clock", "wall", "--duration", 30)
            driving = await Running.start("gameopt_vehicles", *drive)
            before = await observer.until(lambda report: report.commands >= PRESENT // 2)
            memory = resident_bytes(charter.process_id)
            messages = flood(charter.map.intersection, before.time_s + 1.0)
            await asyncio.to_thread(send, observer, messages)
            after = await observer.until(lambda report: report.received_total >= JUNK + MADE_UP)
            grown = resident_bytes(charter.process_id) - memory
            # Those that were made up have gone; those on the road are still commanded.
            calm = await observer.until(lambda report: report.vehicles <= PRESENT)
            ended = await driving.stop()
        assert ended.code == 0, ended.err
        assert after.rejected_total["flood"] > 10_000
        assert after.rejected_total["malformed"] > 100
        assert calm.commands > PRESENT // 2
        assert grown < MOST_GROWTH_BYTES
        flooded = [report for report in observer.reports if before.cycle <= report.cycle <= calm.cycle]
        assert max(report.vehicles for report in flooded) <= Parameters().service.max_vehicles
        commanded = sum(report.commands > PRESENT // 2 for report in flooded)
        assert commanded > 0.75 * (calm.cycle - before.cycle)

    run(scenario)
