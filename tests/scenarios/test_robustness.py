"""Killed managers, killed vehicles, garbage on the network: nobody else is harmed."""

from __future__ import annotations

import json
import math
import signal
from pathlib import Path
from typing import Any

import msgspec
import pytest
from processes import Observer, Running, depart_near, driving, free_endpoint, manager, run, vehicles

from gameopt_sumo.scenarios import FourArm, write_four_arm
from gameopt_wire import codec, keys
from gameopt_wire.messages import CycleReport, State

pytestmark = pytest.mark.processes

HERE = "junction"


@pytest.fixture(scope="module")
def sumocfg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = FourArm(flow_veh_h=6000.0, seed=101, duration_s=600.0)
    return depart_near(write_four_arm(scenario, tmp_path_factory.mktemp("scenario")))


def read(report: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(report.read_bytes())
    assert found["safety"]["collisions_sumo"] == found["safety"]["collisions_geometric"] == 0
    return found


def crossing(report: CycleReport) -> bool:
    return report.cleared >= 2 and report.uncleared >= 2


def test_lockstep_ends_when_its_manager_is_killed(sumocfg: Path, tmp_path: Path) -> None:
    async def scenario() -> None:
        endpoint, file = free_endpoint(), tmp_path / "report.json"
        async with manager("--workers", 0, endpoint=endpoint) as serving, Observer(endpoint) as observer:
            arguments = driving(sumocfg, endpoint, "--duration", 500, "--report", file)
            driven = await Running.start("gameopt_vehicles", *arguments)
            last = await observer.until(crossing)
            serving.signal(signal.SIGKILL)
            ended = await driven.ended()
        assert (ended.code, ended.err) == (3, "gameopt-vehicles: the manager of 'junction' has gone\n")
        assert last.time_s <= read(file)["duration_s"] < 500.0

    run(scenario)


def test_wall_clock_vehicles_wait_for_a_manager_that_was_killed(sumocfg: Path, tmp_path: Path) -> None:
    """They fall back, stop before the line unless cleared, go on under its successor; SIGINT: a report."""

    async def scenario() -> None:
        endpoint, file = free_endpoint(), tmp_path / "report.json"
        arguments = driving(sumocfg, endpoint, "--duration", 500, "--report", file, clock="wall")
        async with manager(endpoint=endpoint, clock="wall") as serving, Observer(endpoint) as observer:
            driven = await Running.start("gameopt_vehicles", *arguments)
            await observer.until(crossing)
            serving.signal(signal.SIGKILL)
            await serving.ended()
        async with manager(endpoint=endpoint, clock="wall"), Observer(endpoint) as observer:
            back = await observer.until(lambda report: report.vehicles > 2)
            states = [codec.STATE.decode(payload) for _, payload in observer.messages("state")]
            # Over the line without a clearance is nobody but who is through already.
            assert all(state.accepted is not None for state in states if -5.0 < state.distance_m < 0.0)
            granted: set[str] = set()
            while len(granted) < 4:
                granted |= set((await observer.until(lambda report: bool(report.granted))).granted)
            await observer.until(lambda _: len(left_under(observer, back.term)) >= 2)
            driven.signal(signal.SIGINT)
            ended = await driven.ended()
        assert (ended.code, ended.err) == (0, "")
        assert read(file)["fallbacks"] > 2

    run(scenario)


def left_under(observer: Observer, term: int) -> set[str]:
    """Who has crossed with a clearance of this term, by the ledger."""
    entries = [codec.LEDGER.decode(payload) for _, payload in observer.messages("ledger")]
    return {entry.vehicle for entry in entries if entry.term == term and entry.left_s is not None}


def test_the_manager_forgets_killed_vehicles(sumocfg: Path, tmp_path: Path) -> None:
    """Whoever was cleared holds its ground for `hold_s`, everybody else is left out after `stale_s`."""
    config = tmp_path / "im.toml"
    config.write_text("[service]\nstale_s = 1.0\nhold_s = 3.0\n")

    async def scenario() -> None:
        endpoint = free_endpoint()
        serve = manager("--config", config, endpoint=endpoint, clock="wall")
        async with serve as serving, Observer(endpoint) as observer:
            driven = await Running.start("gameopt_vehicles", *driving(sumocfg, endpoint, clock="wall"))
            await observer.until(crossing)
            driven.signal(signal.SIGKILL)
            await driven.ended()
            heard_s = max(codec.STATE.decode(payload).time_s for _, payload in observer.messages("state"))
            silent = await observer.until(lambda report: report.silent == report.vehicles > 0)
            gone = await observer.until(lambda report: report.vehicles == 0)
            await serving.said("vehicles lost")
        assert silent.time_s - heard_s < 1.0  # their liveliness tokens say so at once
        assert 1.0 < gone.time_s - heard_s < 3.5

    run(scenario)


def garbage(sample: State, cycle: int) -> list[tuple[str, bytes, str]]:
    """Key, payload and the reason it is counted under; for the control cycle that `sample` was heard in."""

    def key(vehicle: str, stream: Any = "state") -> str:
        return keys.of_vehicle(HERE, stream, vehicle)

    def changed(**fields: Any) -> bytes:
        return msgspec.msgpack.encode(msgspec.to_builtins(sample) | {"vehicle": "ghost"} | fields)

    ghost = key("ghost")
    return [
        (ghost, b"", "malformed"),
        (ghost, b"\xc1" * 40, "malformed"),
        (key("ghost", "bid"), changed(), "malformed"),
        (ghost, changed(version=2), "version"),
        (ghost, changed(distance_m=math.nan), "out_of_range"),
        (ghost, changed(speed_mps=-1.0), "out_of_range"),
        (ghost, changed(max_decel_mps2=math.inf), "out_of_range"),
        (ghost, bytes(codec.MAX_BYTES + 1), "oversized"),
        (key("somebody"), changed(), "key"),
        (ghost, changed(movement="nowhere"), "unknown_movement"),
        (ghost, changed(length_m=39.0), "uncovered"),
        (ghost, changed(time_s=sample.time_s + 100.0), "time"),
        (key(sample.vehicle), codec.STATE.encode(sample), "duplicate"),
    ]


FORGED = {keys.of_vehicle(HERE, "state", name) for name in ("ghost", "somebody")}
REASONS = {
    *("malformed", "version", "out_of_range", "oversized", "key", "unknown_movement", "uncovered", "time"),
    "duplicate",
}


def test_garbage_is_counted_and_changes_nothing(sumocfg: Path, tmp_path: Path) -> None:
    """The same run twice, once with a vandal on the network: not one position differs.

    Before both a simulator is killed amid a step, and what it had said of it must not count in theirs.
    """

    async def drive(endpoint: str, name: str) -> tuple[dict[str, Any], str]:
        report, fcd = tmp_path / f"{name}.json", tmp_path / f"{name}.xml"
        ended = await vehicles(
            *(sumocfg, endpoint, "--duration", 15, "--report", report),
            *("--", "--fcd-output", fcd, "--precision", "9"),
        )
        assert (ended.code, ended.err) == (0, "")
        return read(report), fcd.read_text().partition("-->")[2]

    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager("--workers", 0, endpoint=endpoint), Observer(endpoint) as observer:
            killed = await Running.start("gameopt_vehicles", *driving(sumocfg, endpoint))
            await observer.until(crossing)
            killed.signal(signal.SIGKILL)
            await killed.ended()
            clean, trace = await drive(endpoint, "clean")
            before = observer.reports[-1].rejected_total

            def vandalise(report: CycleReport) -> None:
                # The observer hears its own garbage, too; to sample that would be to forge a vehicle.
                spoken = [payload for key, payload in observer.messages("state") if key not in FORGED]
                if report.vehicles and spoken:
                    for key, payload, _ in garbage(codec.STATE.decode(spoken[-1]), report.cycle):
                        observer.put(key, payload)
                    victim = report.order[0] if report.order else "ghost"
                    for stream in ("command", "ledger"):
                        observer.put(keys.of_vehicle(HERE, stream, victim), b"\xc1")
                    observer.put(keys.cycle(HERE), b"\xc1")
                    observer.put(keys.step(HERE), b"\xc1")

            observer.heard.clear()
            observer.on_report = vandalise
            spoiled, spoiled_trace = await drive(endpoint, "spoiled")
            counted = observer.reports[-1].rejected_total
        assert set(counted) >= REASONS
        assert min(counted[reason] - before.get(reason, 0) for reason in REASONS) > 5
        assert spoiled["messages"]["rejected"] > 10
        assert spoiled_trace == trace
        same = ("vehicles", "safety", "by_class", "fuel_total_g", "fallbacks", "qp")
        assert {name: spoiled[name] for name in same} == {name: clean[name] for name in same}

    run(scenario)
