"""The report has exactly the fixed fields, and the tally counts across managers."""

from __future__ import annotations

import json
from typing import Any

import pytest
from builders import four_arm

from gameopt_vehicles.report import Run, assemble
from gameopt_vehicles.tally import Tally
from gameopt_wire.intersection import Charter
from gameopt_wire.messages import Command, CycleReport

FIELDS = [
    "schema",
    "versions",
    "method",
    "scenario",
    "intersection",
    "profile",
    "geometry",
    "turn_speed",
    "candidates",
    "workers",
    "clock",
    "seed",
    "flow_veh_h",
    "ratio",
    "duration_s",
    "warmup_s",
    "vehicles",
    "throughput_veh_min",
    "time_to_goal_s",
    "time_loss_s",
    "fuel_g",
    "co2_g",
    "fuel_total_g",
    "co2_total_g",
    "by_class",
    "safety",
    "control_cycle",
    "qp",
    "fallbacks",
    "messages",
    "late_steps",
    "round_trip",
    "whole_way",
]
PARTS = {
    "vehicles": "arrived entered crossed in_zone waiting_to_enter",
    "time_to_goal_s": "mean p50 p95 max",
    "time_loss_s": "mean p95 max",
    "safety": "collisions_sumo collisions_geometric min_pet_s hard_brakes teleports",
    "control_cycle": "count missed p50_ms p99_ms max_ms dropped unsolved",
    "qp": "solved failed late",
    "messages": "sent received lost rejected",
    "round_trip": "count unanswered p50_ms p99_ms p999_ms max_ms",
    "whole_way": "vehicles commands_lost whole late stages",
}


def charter() -> Charter:
    ground = four_arm(intersection="main")
    return Charter(
        term=1,
        clock="wall",
        profile="paper",
        geometry="box",
        turn_speed=True,
        candidates=8,
        workers=1,
        process_id=1,
        digest=ground.digest(),
        map=ground,
    )


def cycle_report(term: int, solved: int, missed: int, elapsed_ms: float = 1.0, **also: Any) -> CycleReport:
    counts = dict.fromkeys(("cycle", "vehicles", "uncleared", "cleared", "commands", "candidates"), 0)
    counts |= dict.fromkeys(("selected", "received_total", "fallback", "silent", "qp_failed_total"), 0)
    figures: dict[str, Any] = {
        "term": term,
        "time_s": 0.0,
        "order": [],
        "granted": [],
        "delay_s": 0.0,
        "elapsed_ms": elapsed_ms,
        "stages_ms": {},
        "rejected_total": {},
        "qp_solved_total": solved,
        "qp_late_total": 0,
        "missed_total": missed,
    }
    return CycleReport(**(figures | counts | also))


def command(vehicle: str, cycle: int, term: int = 1) -> Command:
    return Command(vehicle=vehicle, term=term, cycle=cycle, time_s=0.1 * cycle, speed_mps=1.0, valid_until_s=1.0)


def test_the_tally_counts_its_own_window_across_restarts_of_the_manager() -> None:
    tally = Tally()
    for term, solved, missed in [(1, 100, 5), (1, 103, 5), (1, 110, 6), (2, 4, 0), (2, 6, 1)]:
        tally.add(cycle_report(term, solved, missed))
    assert tally.totals["qp_solved_total"] == 10 + 6
    assert tally.totals["missed_total"] == 1 + 1
    tally.restart()
    assert tally.elapsed_ms == []
    tally.add(cycle_report(2, 9, 1))
    assert tally.totals["qp_solved_total"] == 3


def test_the_whole_way_and_its_stages_are_those_of_the_manager_s_reports() -> None:
    tally = Tally()
    for cycle, whole_ms in enumerate((4.0, 6.0, 5.0)):
        stages_ms = {"ingest": 1.0, "publish": whole_ms - 1.0}
        tally.add(cycle_report(1, 0, 0, cycle=cycle, vehicles=10 * cycle, whole_ms=whole_ms, stages_ms=stages_ms))
    way = tally.whole_way()
    assert way.whole is not None
    assert (way.vehicles, way.whole.max_ms, way.late) == (10.0, 6.0, None)
    assert list(way.stages) == ["ingest", "publish"]
    assert way.stages["publish"].max_ms == 5.0
    tally.restart()
    assert tally.whole_way().whole is tally.whole_way().vehicles is None


def test_commands_lost_are_those_announced_that_have_not_come_by_the_next_report() -> None:
    tally = Tally()
    tally.heard(command("a", 1), 0.0)
    tally.add(cycle_report(1, 0, 0, cycle=1, commands=3))
    tally.heard(command("b", 1), 0.0)  # another thread brought it: after the report of its control cycle
    assert tally.whole_way().commands_lost == 0
    tally.add(cycle_report(1, 0, 0, cycle=2, commands=0))
    assert tally.whole_way().commands_lost == 1
    tally.add(cycle_report(2, 0, 0, cycle=1, commands=1))
    tally.add(cycle_report(2, 0, 0, cycle=2))
    assert tally.whole_way().commands_lost == 2


def test_the_report_has_the_fixed_fields_and_null_where_lacking() -> None:
    tally = Tally()
    for elapsed_ms in (1.0, 2.0, 9.0):
        tally.add(cycle_report(1, 0, 0, elapsed_ms))
    measured = {"vehicles": {"crossed": 3}, "by_class": {"truck": {"count": 1}}, "fuel_g": 2.5}
    run = Run(scenario="four-arm", seed=3, duration_s=60.0, warmup_s=0.0)
    report = json.loads(assemble(run, charter(), measured, tally, lost=7).to_json())
    assert list(report) == FIELDS
    assert {name: " ".join(report[name]) for name in PARTS} == PARTS
    assert list(report["by_class"]["truck"]) == ["count", "time_to_goal_s", "fuel_g", "co2_g"]
    assert (report["method"], report["vehicles"]["crossed"], report["fuel_g"]) == ("coop-paper", 3, 2.5)
    assert report["co2_g"] is report["flow_veh_h"] is report["safety"]["min_pet_s"] is None
    assert (report["control_cycle"]["p50_ms"], report["control_cycle"]["max_ms"]) == (2.0, 9.0)
    assert report["messages"]["lost"] == 7


@pytest.mark.parametrize("count", ["collisions_sumo", "collisions_geometric", "teleports"])
def test_any_collision_fails_the_run(count: str) -> None:
    run = Run(scenario="x", seed=1, duration_s=1.0, warmup_s=0.0)
    assert not assemble(run, charter(), {}, Tally(), 0).collided()
    assert assemble(run, charter(), {"safety": {count: 1}}, Tally(), 0).collided()
