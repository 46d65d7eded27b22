"""The paper's claims against made-up measurements: what is reproduced, what is not, and what there are no data for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from compared import SETTINGS, put, report, run

from gameopt_sumo.compare.claims import Row, decisions, missed, over_others, unbalanced
from gameopt_sumo.compare.computation import Computation, Decision, Joint
from gameopt_sumo.compare.reasons import MET, STRONGER, TOTALS, UNKNOWN, UPSTREAM
from gameopt_sumo.compare.results import Figure, gather
from gameopt_sumo.compare.verdicts import NO_DATA, over_another, over_itself


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
        (124.0, 100.0, "+24.0%", "not reproduced: smaller"),
        (110.0, 100.0, "+10.0%", "not reproduced: smaller"),
        (100.0, 100.0, "+0.0%", "not reproduced: no change"),
        (90.0, 100.0, "-10.0%", "not reproduced: the other way"),
    ],
)
def test_more_is_better(tmp_path: Path, ours: float, lights: float, measured: str, verdict: str) -> None:
    put_all(tmp_path, {"coop": {"throughput_veh_min": ours}, "fixed": {"throughput_veh_min": lights}})
    row = row_of(over_others(gather(tmp_path, SETTINGS), "coop", 10000.0), "throughput, over traffic lights")
    assert (row.claimed, row.measured, row.seeds, row.verdict) == ("at least +25%", measured, "1", verdict)
    assert row.ratio == f"{ours / lights / 1.25:.2f}"


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
    assert (time.claimed, time.measured, time.waiting, time.verdict) == (
        "around -83%",
        "-90.0%",
        "0 / 77",
        "reproduced",
    )
    assert row_of(rows, "fuel per vehicle, over stop sign").verdict == "not reproduced: smaller"


def test_a_claim_without_data_says_so(tmp_path: Path) -> None:
    put_all(tmp_path, {"coop": {}})
    put(tmp_path, run("fixed"), failed="no lights")
    entries = gather(tmp_path, SETTINGS)
    everything = [*over_others(entries, "coop", 10000.0), *unbalanced(entries, "coop", 5200.0)]
    assert {row.verdict for row in everything} == {row.measured for row in everything} == {NO_DATA}
    assert all(row.label for row in everything)


@pytest.mark.parametrize(
    ("claimed", "at_least", "change", "half", "verdict"),
    [
        (-0.70, True, -0.70, None, "reproduced"),
        (-0.70, True, -0.69, None, "not reproduced: smaller"),
        (-0.70, True, -0.72, 0.03, "not decided"),
        (-0.70, True, -0.67, 0.04, "not decided"),
        (-0.70, True, -0.74, 0.03, "reproduced"),
        (-0.80, False, -0.79, None, "reproduced"),  # 0.21 left, claimed 0.20: within a tenth
        (-0.80, False, -0.76, None, "not reproduced: smaller"),  # 0.24 left, a fifth more than claimed
        (-0.80, False, 0.10, 0.05, "not reproduced: the other way"),
        (1.37, False, 1.20, 0.01, "reproduced"),
        (1.37, False, 1.10, 0.01, "not reproduced: smaller"),
    ],
)
def test_what_is_left_is_judged_and_its_interval(
    claimed: float, at_least: bool, change: float, half: float | None, verdict: str
) -> None:
    assert over_another(Figure(change, half, 3), claimed, at_least) == verdict


@pytest.mark.parametrize(
    ("claimed", "change", "half", "verdict"),
    [
        (0.0, 0.02, 0.01, "reproduced"),
        (0.0, 0.02, 0.04, "not decided"),
        (0.0, 0.10, 0.04, "not reproduced: it changes"),
        (-0.20, -0.22, 0.02, "reproduced"),
        (-0.20, -0.24, 0.02, "not decided"),
        (-0.20, -0.40, 0.02, "not reproduced: larger"),
    ],
)
def test_what_a_method_itself_loses_is_judged_with_its_interval(
    claimed: float, change: float, half: float, verdict: str
) -> None:
    assert over_itself(Figure(change, half, 3), claimed) == verdict


def test_a_row_says_how_many_seeds_have_the_figure(tmp_path: Path) -> None:
    for seed in (101, 102, 103):
        put(tmp_path, run("coop", seed=seed), report(throughput_veh_min=130.0 + seed / 100.0))
        put(tmp_path, run("fixed", seed=seed), report(throughput_veh_min=100.0 if seed > 101 else None))
    rows = over_others(gather(tmp_path, SETTINGS), "coop", 10000.0)
    assert row_of(rows, "throughput, over traffic lights").seeds == "2 of 3"


def reason_of(out: Path, words: str, ours: dict[str, Any], lights: dict[str, Any]) -> str:
    put_all(out, {"coop": ours, "fixed": lights})
    return row_of(over_others(gather(out, SETTINGS), "coop", 10000.0), f"{words}, over traffic lights").reason


def test_what_is_reproduced_or_not_measured_needs_no_reason(tmp_path: Path) -> None:
    assert reason_of(tmp_path, "fuel per vehicle", {"fuel_g": 10.0}, {"fuel_g": 30.0}) == ""
    rows = over_others(gather(tmp_path, SETTINGS), "coop", 10000.0)
    assert row_of(rows, "throughput, over stop sign").reason == ""


def test_a_time_is_hidden_upstream_only_where_more_vehicles_are(tmp_path: Path) -> None:
    words, left, zone = "time-to-goal", "vehicles__waiting_to_enter", "vehicles__in_zone"
    ours: dict[str, Any] = {left: 2, zone: 20}
    assert reason_of(tmp_path / "upstream", words, ours, {left: 60, zone: 20}) == UPSTREAM
    assert reason_of(tmp_path / "in the zone", words, ours, {left: 2, zone: 60}) == UPSTREAM
    assert reason_of(tmp_path / "nobody", words, ours, {left: 3, zone: 22}) == UNKNOWN
    assert reason_of(tmp_path / "ours", words, {left: 60, zone: 60}, ours) == UNKNOWN


def test_a_total_is_larger_where_more_vehicles_crossed(tmp_path: Path) -> None:
    more, fewer = {"vehicles__crossed": 80}, {"vehicles__crossed": 60}
    assert reason_of(tmp_path / "more", "fuel of all that crossed", more, fewer) == TOTALS
    assert reason_of(tmp_path / "fewer", "fuel of all that crossed", fewer, more) == UNKNOWN


def test_throughput_that_is_missed_has_a_reason_or_none_that_is_known(tmp_path: Path) -> None:
    def why(name: str, ours: tuple[int, int], lights: tuple[int, int]) -> str:
        """Each crossed and waiting, of 100 that arrived."""
        of = [
            {
                "throughput_veh_min": float(crossed),
                "vehicles__arrived": 100,
                "vehicles__crossed": crossed,
                "vehicles__waiting_to_enter": waiting,
            }
            for crossed, waiting in (ours, lights)
        ]
        return reason_of(tmp_path / name, "throughput", *of)

    assert why("met", (98, 0), (97, 1)) == MET
    assert why("stronger", (98, 0), (85, 10)) == f"{STRONGER} (plan: `plans/fixed-10000-ratio1/plan.json`)"
    assert why("both overloaded", (60, 38), (55, 43)) == UNKNOWN
    assert why("behind", (80, 15), (90, 8)) == UNKNOWN


def test_reasons_are_told_with_what_they_are_for(tmp_path: Path) -> None:
    put_all(tmp_path, {"coop": {}, "fixed": {}})
    told = missed(over_others(gather(tmp_path, SETTINGS), "coop", 10000.0))
    assert told[MET] == ["throughput, over traffic lights"]
    assert "time-to-goal, over traffic lights" in told[UNKNOWN]


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


def joint(vehicles: int, factor: float, proven: float = 1.0) -> Joint:
    return Joint(vehicles, 20, proven, joint_ms=1.0, auction_ms=1.0, full_rows_ms=1.0, factor=factor, excess=0.01)


def test_decision_time_stands_beside_the_profile_it_is_of(tmp_path: Path) -> None:
    for method in ("coop", "coop-paper", "coop@box"):
        put(tmp_path, run(method), report(control_cycle__p50_ms=4.0, control_cycle__p99_ms=12.0))
    entries = gather(tmp_path, SETTINGS)
    measured = Computation([Decision(50, 4.0, 8.0), Decision(100, 7.0, 12.0), Decision(200, 13.0, 20.0)], [joint(4, 9)])
    under, alone = decisions(entries, "coop", measured)
    assert (under.measured, under.verdict) == ("4.0 and 12.0 ms", "the median only")
    assert (alone.measured, alone.verdict) == (
        "up to 100 and 50 vehicles of 200 tried",
        "reproduced up to 50 vehicles",
    )
    _, faster = decisions(entries, "coop-paper", measured)
    assert "MIQP" in faster.words
    assert len(decisions(entries, "coop@box", measured)) == 1


@pytest.mark.parametrize(
    ("sizes", "measured", "ratio", "verdict"),
    [
        ([joint(4, 120.0), joint(8, 3000.0, 0.75)], "120 to at least 3,000 times, 4 to 8 vehicles", "1.20 to 30.00",
         "reproduced"),
        ([joint(4, 12.0), joint(6, 150.0), joint(8, 900.0)], "12 to 900 times, 4 to 8 vehicles", "0.12 to 9.00",
         "reproduced from 6 vehicles on"),
        ([joint(4, 150.0), joint(8, 60.0)], "60 to 150 times, 4 to 8 vehicles", "0.60 to 1.50",
         "not reproduced: smaller"),
        ([joint(4, 150.0)], "150 times, 4 vehicles", "1.50", "reproduced"),
    ],
)  # fmt: skip
def test_the_speed_up_is_judged_over_all_sizes(sizes: list[Joint], measured: str, ratio: str, verdict: str) -> None:
    _, faster = decisions([], "coop-paper", Computation([], sizes))
    assert (faster.measured, faster.ratio, faster.verdict) == (measured, ratio, verdict)
