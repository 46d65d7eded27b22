"""The benchmark measures the real manager, on traffic that does as it is told."""

from __future__ import annotations

import asyncio
from collections import Counter
from pathlib import Path

import msgspec
import pytest
from structlog.testing import capture_logs

from gameopt_im import bench as benchmark
from gameopt_im import cli
from gameopt_im.bench import DECISION, PERCENTILES, SETTLING_CYCLES, WITHOUT, Results
from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters
from gameopt_im.inbox import Raw
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.recorder import Recorder
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import charter_of
from gameopt_im.solver.contest import solver_for
from gameopt_sumo.network import packaged_map
from gameopt_wire import codec
from gameopt_wire.messages import STEP_S, State


def states(messages: list[Raw]) -> list[State]:
    return [codec.STATE.decode(raw.payload) for raw in messages if raw.kind == "state"]


def test_made_up_traffic_crosses_and_is_kept_up() -> None:
    """Sixty vehicles for a minute: none strays, none is in the zone without a clearance, and the number holds."""
    options = ServeOptions(map=packaged_map(), parameters=Parameters(), workers=0, clock="lockstep")
    traffic = Rehearsal(options.map, 60)
    seen: Counter[str] = Counter()

    async def drive() -> None:
        async with solver_for("default", 0, Parameters()) as pool:
            manager = Manager(options, 1, pool)
            for cycle in range(1, 600):
                messages = traffic.messages(cycle * STEP_S)
                seen.update(state.vehicle for state in states(messages))
                assert len(states(messages)) <= 60
                outcome = await manager.control_cycle(cycle, cycle * STEP_S, messages)
                assert outcome.report.rejected_total == {}
                assert outcome.report.withdrawn == 0
                traffic.obey(outcome.commands)

    asyncio.run(drive())
    assert len(seen) > 150
    assert len(states(traffic.messages(60.0))) == 60


def test_every_stage_has_its_percentiles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bench.json"
    said = ["bench", "--vehicles", "6,9,12", "--cycles", "25", "--workers", "0", "--no-ratios", "--json", str(file)]
    assert cli.run(said) == 0
    printed = capsys.readouterr().out
    assert "12 vehicles" in printed
    assert "growth with the vehicles present" in printed
    results = msgspec.json.decode(file.read_bytes(), type=Results)
    assert results.schema == "gameopt-bench/2"
    assert results.ratios == []
    assert {"auction", DECISION, WITHOUT} < {each.stage for each in results.growth}
    assert {"python", "osqp"} < results.versions.keys()
    assert [each.traffic for each in results.measured] == ["6 vehicles", "9 vehicles", "12 vehicles"]
    for each in results.measured:
        assert each.cycles == 25
        assert {"ingest", "snapshot", "auction", "programs", "interlock", "commands"} < set(each.stages_ms)
        for figures in each.stages_ms.values():
            assert list(figures) == list(PERCENTILES)
            assert 0.0 < figures["p50"] <= figures["p99"] <= figures["max"]
        assert each.stages_ms[WITHOUT]["p50"] <= each.stages_ms[DECISION]["p50"]


@pytest.mark.parametrize("vehicles", ["", "many", "0", "5,-1", "2001"])
def test_numbers_that_cannot_be_made_up_are_one_line(vehicles: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["bench", "--vehicles", vehicles]) == 2
    said = capsys.readouterr().err
    assert "whole numbers from 1 to 2000" in said
    assert said.count("\n") == 1


def test_a_recording_is_decided_under_its_own_term(tmp_path: Path) -> None:
    """Under another one every vehicle on a clearance would be taken for an intruder."""
    options = ServeOptions(map=packaged_map(), parameters=Parameters(), workers=0, clock="lockstep")
    path, traffic = tmp_path / "run.mcap", Rehearsal(options.map, 8)

    async def record() -> None:
        async with solver_for("default", 0, Parameters()) as pool:
            manager = Manager(options, 7, pool)
            with Recorder(path, charter_of(options, 7), options.parameters, ()) as recorder:
                for cycle in range(1, SETTLING_CYCLES + 50):
                    tick = Tick(cycle, cycle * STEP_S, traffic.messages(cycle * STEP_S))
                    outcome = await manager.control_cycle(tick.cycle, tick.time_s, tick.messages)
                    recorder.record(tick, outcome.commands)
                    traffic.obey(outcome.commands)

    asyncio.run(record())
    with capture_logs() as said:
        results = asyncio.run(benchmark.run(benchmark.Bench(options, (2,), [path], 1, ratios=False)))
    assert results.measured[-1].cycles == 49
    assert [each["event"] for each in said if each["log_level"] == "warning"] == []
