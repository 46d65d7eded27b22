"""`gameopt-sumo compare` for real: manager and vehicles as processes, a baseline, and the folder they leave."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.processes


def compare(out: Path, *different: str) -> subprocess.CompletedProcess[str]:
    code = "from gameopt_sumo.cli import main; main()"
    usual = ["--methods", "coop,all-way-stop", "--flows", "3000", "--seeds", "1"]
    command = [sys.executable, "-c", code, "compare", *usual, "--duration", "30", "--warmup", "10", "--out", str(out)]
    return subprocess.run([*command, *different], capture_output=True, text=True, check=False)


def test_once_again_and_with_other_settings(tmp_path: Path) -> None:
    out = tmp_path / "results"
    first = compare(out)
    assert first.returncode == 0, first.stderr
    coop, stop = entries(out)
    assert (coop["method"], stop["method"]) == ("coop", "all-way-stop")
    for entry in (coop, stop):
        assert entry["duration_s"] == 30.0
        assert entry["flow_veh_h"] == 3000.0
        assert entry["seed"] == 101
        assert entry["failed"] is None
        assert entry["vehicles"]["crossed"] > 0
        assert not any(entry["safety"][name] for name in ("collisions_sumo", "collisions_geometric", "teleports"))
    assert coop["vehicles"]["arrived"] == stop["vehicles"]["arrived"]
    assert coop["time_to_goal_s"]["mean"] < stop["time_to_goal_s"]["mean"]
    # The real system has been at work: a manager's process, control cycles, messages both ways.
    assert coop["manager_pid"] > 1
    assert coop["control_cycle"]["count"] == 200
    assert min(coop["messages"]["sent"], coop["messages"]["received"]) > 100
    assert stop["manager_pid"] is stop["messages"] is None

    with (out / "results.csv").open() as file:
        assert [row["method"] for row in csv.DictReader(file)] == ["all-way-stop", "coop"]
    assert "| 3000 | coop | 1 |" in (out / "report.md").read_text()
    assert (out / "plots" / "flows-throughput.png").exists()

    before = stamps(out)
    again = compare(out)
    assert again.returncode == 0, again.stderr
    assert "2 runs, 2 of them were there" in again.stdout
    assert stamps(out) == before

    other = compare(out, "--warmup", "20")
    assert other.returncode == 2
    assert "warmup_s 10.0, not 20.0; choose another --out" in other.stderr
    assert other.stderr.count("\n") == 1
    assert stamps(out) == before


def entries(out: Path) -> list[dict[str, Any]]:
    return sorted(json.loads((out / "results.json").read_text()), key=lambda entry: entry["method"] != "coop")


def stamps(out: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in out.glob("runs/*/report.json")}
