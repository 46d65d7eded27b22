"""Two managers on one Zenoh network, one SUMO net, and vehicles that pass both junctions."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sumo_runs

DEPLOY = Path(__file__).parents[2] / "deploy"
sys.path.insert(0, str(DEPLOY))

from two_junctions import write_scenario  # noqa: E402 - a script, in no package

PATIENCE_S = 180.0


def made(folder: Path) -> dict[str, Any]:
    """The reports of the demo by junction, without what depends on the machine."""
    folder.mkdir()
    command = [sys.executable, DEPLOY / "two_junctions.py", "--seconds", "60"]
    done = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr
    found = {}
    for junction in ("west", "east"):
        report = json.loads((folder / f"out/two-junctions/report.{junction}.json").read_text())
        for varies in ("control_cycle", "round_trip", "whole_way"):
            del report[varies]
        found[junction] = report
    return found


@pytest.mark.processes
def test_each_manager_serves_its_own_and_both_do_the_same_again(tmp_path: Path) -> None:
    reports = made(tmp_path / "first")
    for junction, report in reports.items():
        assert report["intersection"] == junction
        assert report["vehicles"]["crossed"] > 5
        assert report["fallbacks"] == 0
        assert (report["safety"]["collisions_sumo"], report["safety"]["collisions_geometric"]) == (0, 0)
    assert made(tmp_path / "again") == reports


@pytest.mark.processes
def test_a_vehicle_is_given_back_by_one_junction_before_the_other_takes_it(
    tmp_path: Path, run: Callable[..., Any]
) -> None:
    found = run(sumo_runs.by_both, write_scenario(tmp_path, 60.0, 1, apart_m=360.0), ("west", "east"), 900)
    assert found["at_once"] == []
    assert len(found["gaps_s"]) > 5
    assert max(found["gaps_s"]) < 0.25  # the one that looks first sees it given back a step later


@pytest.mark.processes
def test_junctions_too_near_each_other_are_refused_in_one_line(tmp_path: Path, run: Callable[..., Any]) -> None:
    said = run(sumo_runs.by_both, write_scenario(tmp_path, 60.0, 1, apart_m=180.0), ("west", "east"), 1)
    assert said.startswith("the control zone of junction 'east' begins ")
    assert said.endswith(" m behind 'west' on lane west_east_0; allowed: 30 m or more")
