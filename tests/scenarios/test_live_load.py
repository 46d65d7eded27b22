"""A manager and synthetic vehicles, two processes by the wall clock: everybody is answered, and the report says so."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from processes import command, free_endpoint, manager, run

pytestmark = pytest.mark.processes

VEHICLES, SECONDS = 12, 4
STAGES = ["ingest", "snapshot", "auction", "programs", "interlock", "commands", "publish"]


def test_synthetic_vehicles_are_answered_every_control_cycle(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    endpoint = free_endpoint()
    length = ("--duration", SECONDS, "--report", path)

    async def scenario() -> None:
        async with manager("--workers", "0", endpoint=endpoint, clock="wall"):
            synthetic = ("--synthetic", VEHICLES, "--connect", endpoint, "--clock", "wall", *length)
            code, _, err = await command("gameopt_vehicles", *synthetic)
            assert (code, err) == (0, "")

    run(scenario)
    report = json.loads(path.read_text())
    states = VEHICLES * 10 * SECONDS
    trip, way = report["round_trip"], report["whole_way"]
    assert report["messages"]["sent"] > states
    # Those of the last step may have no answer any more; a busy machine may miss a control cycle, not most.
    assert trip["count"] + trip["unanswered"] <= states
    assert trip["count"] > states / 2
    assert report["messages"]["received"] >= trip["count"]
    assert way["commands_lost"] == report["messages"]["rejected"] == 0
    assert 0 < way["vehicles"] <= VEHICLES
    assert list(way["stages"]) == STAGES
    assert way["whole"]["max_ms"] >= max(stage["max_ms"] for stage in way["stages"].values())
    assert way["whole"]["p50_ms"] > report["control_cycle"]["p50_ms"] > 0.0  # the decision, and what is round it
    assert trip["p50_ms"] > way["whole"]["p50_ms"]
