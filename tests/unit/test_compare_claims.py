"""The paper's claims against made-up measurements: what is reproduced, what is not, and what there are no data for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from compared import SETTINGS, put, report, run

from gameopt_sumo.compare.claims import (
    LITERAL,
    NO_DATA,
    TOTALS,
    UPSTREAM,
    Row,
    decisions,
    over_others,
    reasons,
    unbalanced,
)
from gameopt_sumo.compare.computation import Computation, Decision, Joint
from gameopt_sumo.compare.results import gather


def row_of(rows: list[Row], words: str) -> Row:
    (found,) = (row for row in rows if row.words == words)
    return found


def put_all(out: Path, by_method: dict[str, dict[str, Any]], **demand: Any) -> None:
    for method, figures in by_method.items():
        put(out, run(method, **demand), report(**figures))


@pytest.mark.parametrize(
    ("ours", "lights", "measured", "verdict"),
    [
        (125.0, 100.0, "+25.0%", "reproduced"),
        (160.0, 100.0, "+60.0%", "reproduced"),
        (123.0, 100.0, "+23.0%", "reproduced"),
        (110.0, 100.0, "+10.0%", "not reproduced: smaller"),
        (100.0, 100.0, "+0.0%", "not reproduced: no change"),
        (90.0, 100.0, "-10.0%", "not reproduced: the other way"),
    ],
)
def test_more_is_better(tmp_path: Path, ours: float, lights: float, measured: str, verdict: str) -> None:
    put_all(tmp_path, {"coop": {"throughput_veh_min": ours}, "fixed": {"throughput_veh_min": lights}})
    row = row_of(over_others(gather(tmp_path, SETTINGS), "coop", 10000.0), "throughput, over traffic lights")
    assert (row.claimed, row.measured, row.verdict) == ("+25%", measured, verdict)
    assert row.ratio == f"{(ours / lights - 1.0) / 0.25:.2f}"


def test_less_is_better(tmp_path: Path) -> None:
    put_all(
        tmp_path,
        {
            "coop": {"time_to_goal_s__mean": 10.0, "fuel_g": 30.0, "vehicles__waiting_to_enter": 0},
            "stop-sign": {"time_to_goal_s__mean": 100.0, "fuel_g": 60.0, "vehicles__waiting_to_enter": 77},
        },
    )
    rows = over_others(gather(tmp_path, SETTINGS), "coop", 10000.0)
    time = row_of(rows, "time-to-goal, over stop sign")
    assert (time.claimed, time.measured, time.waiting, time.verdict) == ("-83%", "-90.0%", "0 / 77", "reproduced")
    assert row_of(rows, "fuel per vehicle, over stop sign").verdict == "not reproduced: smaller"


def test_a_claim_without_data_says_so(tmp_path: Path) -> None:
    put_all(tmp_path, {"coop": {}})
    put(tmp_path, run("fixed"), failed="no lights")
    entries = gather(tmp_path, SETTINGS)
    everything = [*over_others(entries, "coop", 10000.0), *unbalanced(entries, "coop", 5200.0)]
    assert {row.verdict for row in everything} == {row.measured for row in everything} == {NO_DATA}
    assert all(row.label for row in everything)


def test_what_is_not_reproduced_has_reasons(tmp_path: Path) -> None:
    put_all(tmp_path, {"coop": {"fuel_g": 10.0, "fuel_total_g": 900.0}, "fixed": {"fuel_g": 30.0}})
    rows = over_others(gather(tmp_path, SETTINGS), "coop", 10000.0)
    fuel, total = (row_of(rows, f"fuel {of}, over traffic lights") for of in ("per vehicle", "of all that crossed"))
    assert reasons([fuel], literal=True) == []
    assert reasons([total], literal=False) == [TOTALS]
    assert reasons([total], literal=True) == [TOTALS, LITERAL]
    assert reasons([row_of(rows, "time-to-goal, over traffic lights")], literal=False) == [UPSTREAM]
    assert reasons([row_of(rows, "throughput, over traffic lights")], literal=False) == []


def test_unbalanced_inflow(tmp_path: Path) -> None:
    at = {"flow_veh_h": 5200.0}
    put_all(
        tmp_path,
        {
            "coop": {"throughput_veh_min": 80.0, "time_to_goal_s__mean": 10.0},
            "fixed": {"throughput_veh_min": 80.0, "time_to_goal_s__mean": 40.0},
            "actuated": {"throughput_veh_min": 80.0},
            "stop-sign": {"throughput_veh_min": 40.0},
        },
        **at,
    )
    put_all(
        tmp_path,
        {
            "coop": {"throughput_veh_min": 81.0, "time_to_goal_s__mean": 11.0},
            "fixed-held": {"throughput_veh_min": 64.0, "time_to_goal_s__mean": 80.0},
            "actuated": {"throughput_veh_min": 79.0},
            "stop-sign": {"throughput_veh_min": 36.0},
        },
        ratio=4.0,
        **at,
    )
    rows = unbalanced(gather(tmp_path, SETTINGS), "coop", 5200.0)
    assert [(row.measured, row.verdict) for row in rows] == [
        ("+1.2%", "reproduced"),
        ("+10.0%", "not reproduced: it changes"),
        ("-20.0%", "reproduced"),
        ("+100.0%", "not reproduced: larger"),
        ("-1.2%", "not reproduced: smaller"),
        ("-10.0%", "not reproduced: the other way"),
    ]


def test_decision_time(tmp_path: Path) -> None:
    put_all(tmp_path, {"coop": {"control_cycle__p50_ms": 4.0, "control_cycle__p99_ms": 12.0}})
    joint = Joint(8, 20, 0.75, joint_ms=6000.0, auction_ms=2.0, full_rows_ms=3.0, factor=3000.0, excess=0.01)
    alone = [Decision(50, 4.0, 8.0), Decision(100, 7.0, 12.0), Decision(200, 13.0, 20.0)]
    under, quiet, faster = decisions(gather(tmp_path, SETTINGS), "coop", Computation(alone, [joint]))
    assert quiet.measured == "up to 100 and 50 vehicles of 200 tried"
    assert (under.measured, under.verdict) == ("4.0 and 12.0 ms", "the median only")
    assert (faster.measured, faster.ratio, faster.verdict) == (
        "at least 3,000 times at 8 vehicles",
        "30.00",
        "reproduced",
    )
