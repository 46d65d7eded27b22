"""SUMO's own controls on a scenario's arrivals: the command, its report, and the search for a plan."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gameopt_sumo.baselines.plan import Plan, write_plan
from gameopt_sumo.baselines.report import Report
from gameopt_sumo.baselines.tuning import PLAN_FILE, SEARCH_FILE, read_search
from gameopt_sumo.baselines.webster import webster
from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow

PATIENCE_S = 240.0
"""Nothing takes this long; what would otherwise hang fails instead."""
QUIET = FourArm(flow_veh_h=2000.0, seed=101, duration_s=150.0)
BUSY = FourArm(flow_veh_h=10_000.0, seed=101, duration_s=90.0)


def command(*arguments: object, text: str | None = None) -> str:
    """What the command prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "gameopt_sumo.baselines", *map(str, arguments)],
        capture_output=True,
        text=True,
        input=text,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def driven(folder: Path, scenario: FourArm, warmup_s: float, *method: object) -> dict[str, Any]:
    """The report of one run."""
    config = write_four_arm(scenario, folder)
    times = ["--duration", scenario.duration_s, "--warmup", warmup_s, "--seed", scenario.seed]
    command("run", config, "--method", *method, *times, "--report", folder / "report.json")
    return dict(json.loads((folder / "report.json").read_bytes()))


def kept(folder: Path, plan: Plan) -> Path:
    file = folder / "plan.json"
    write_plan(plan, file)
    return file


def safe(report: dict[str, Any]) -> bool:
    safety = report["safety"]
    return not (safety["collisions_sumo"] or safety["collisions_geometric"] or safety["teleports"])


def test_fixed_lights_serve_2000_an_hour(tmp_path: Path) -> None:
    plan = kept(tmp_path, webster(QUIET, "fixed", "protected"))
    report = driven(tmp_path, QUIET, 30.0, "fixed", "--plan", plan, "--name", "fixed-held")
    assert list(report) == list(Report.__struct_fields__)
    assert (report["method"], report["scenario"], report["intersection"]) == ("fixed-held", "four-arm", "junction")
    assert (report["flow_veh_h"], report["ratio"], report["seed"]) == (2000.0, 1.0, 101)
    assert (report["duration_s"], report["warmup_s"], report["turn_speed"]) == (150.0, 30.0, True)
    assert all(report[name] is None for name in ("profile", "geometry", "control_cycle", "qp", "messages", "fallbacks"))
    vehicles = report["vehicles"]
    assert vehicles["waiting_to_enter"] <= 5
    assert vehicles["crossed"] > 30
    assert 15.0 < report["time_to_goal_s"]["mean"] < 60.0
    assert safe(report)


@pytest.mark.parametrize("left", ["permissive", "both"])
def test_nobody_collides_turning_left_through_gaps(tmp_path: Path, left: Any) -> None:
    plan = kept(tmp_path, webster(BUSY, "fixed", left, 60.0))
    report = driven(tmp_path, BUSY, 20.0, "fixed", "--plan", plan)
    assert report["vehicles"]["crossed"] > 60
    assert safe(report)


def test_an_all_way_stop_stops_everybody(tmp_path: Path) -> None:
    report = driven(tmp_path, QUIET, 30.0, "all-way-stop")
    assert report["vehicles"]["crossed"] > 20
    assert report["time_loss_s"]["mean"] > 4.0  # from 20 m/s to a halt and back
    assert safe(report)


def test_the_search_counts_what_the_meter_counts(tmp_path: Path) -> None:
    """A plan's trial against a measured run of the same arrivals, where a queue reaches out of the zone."""
    plan = webster(BUSY, "actuated", "both", 60.0)
    report = driven(tmp_path, BUSY, 20.0, "actuated", "--plan", kept(tmp_path, plan))
    times = ["--duration", BUSY.duration_s, "--warmup", 20.0]
    text = msgspec.json.encode(plan).decode()
    trial = json.loads(command("try", tmp_path / "four-arm.sumocfg", *times, "--seeds", 101, text=text))[0]
    waiting = report["vehicles"]["waiting_to_enter"]
    assert waiting > 10
    assert abs(trial["unserved"] - waiting) <= 1


def test_a_search_goes_on_where_it_was_and_ends_the_same(tmp_path: Path) -> None:
    def search(folder: str, budget: int, jobs: int) -> Path:
        settings = ["--flow", 2000, "--method", "actuated", "--seeds", "201", "--duration", 40, "--warmup", 10]
        printed = command("tune", *settings, "--budget", budget, "--jobs", jobs, "--out", tmp_path / folder)
        assert printed.strip() == str(tmp_path / folder / PLAN_FILE)
        return tmp_path / folder

    whole = search("whole", 5, 2)
    cut = search("cut", 3, 1)
    record = cut / SEARCH_FILE
    lines = record.read_bytes().splitlines(keepends=True)
    worst = max(read_search(record), key=lambda line: line.score).number
    # Worse still, so that the best stays the best: what is on record is not tried again.
    lines[worst] = lines[worst].replace(b'"mean_time_s":', b'"mean_time_s":1', 1)
    record.write_bytes(b"".join(lines) + b'{"number":3,"pl')
    search("cut", 5, 1)

    resumed, uninterrupted = (
        folder.joinpath(SEARCH_FILE).read_bytes().splitlines(keepends=True) for folder in (cut, whole)
    )
    assert resumed[:3] == lines
    assert resumed[:worst] + resumed[worst + 1 :] == uninterrupted[:worst] + uninterrupted[worst + 1 :]
    looked = read_search(whole / SEARCH_FILE)
    best = min(looked, key=lambda line: line.score).plan
    assert msgspec.json.decode((whole / PLAN_FILE).read_bytes(), type=Plan) == best
    assert (cut / PLAN_FILE).read_bytes() == (whole / PLAN_FILE).read_bytes()
