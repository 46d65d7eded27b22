"""The load test's own arithmetic: shares of a core, growth of memory, and what counts as held."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import click
import pytest

sys.path.append(str(Path(__file__).parents[1] / "load"))
from control_cycles import AtSpeed, ControlCycles
from live import MB, Line, Load, Measured, Sample, Watch
from machine import FixedWork, cores

from gameopt_vehicles.timings import Spread

SPREAD = {"p50_ms": 1.0, "p99_ms": 4.0, "p999_ms": 8.0, "max_ms": 9.0}
AT_SPEED = AtSpeed(5.1, 93.0, Spread(p50_ms=1.0, p99_ms=3.5, p999_ms=4.0, max_ms=4.5))


def report(missed: int) -> dict[str, Any]:
    return {
        "control_cycle": {"count": 100, "missed": missed},
        "throughput_veh_min": 12.34,
        "fallbacks": 0,
        "late_steps": 0,
        "qp": {"late": 3},
        "round_trip": {"count": 1000, "unanswered": 0, **SPREAD},
        "whole_way": {
            "vehicles": 59.5,
            "commands_lost": 0,
            "whole": SPREAD,
            "late": None,
            "stages": {"ingest": SPREAD},
        },
    }


def measured(vehicles: int, missed: int = 0) -> Measured:
    used = {"manager_percent": 40.0, "workers_percent": 25.0, "vehicles_percent": 10.0}
    return Measured(Load(vehicles, 60), 1, report(missed), used | {"resident_mb": 400.0, "growth_mb": 0.5}, AT_SPEED)


def test_shares_and_growth_are_those_after_the_warm_up() -> None:
    def sample(at_s: int) -> Sample:
        busy_s, resident = (0.5 * at_s, 300 * MB) if at_s < 30 else (15.0 + 0.1 * (at_s - 30), (400 + at_s // 100) * MB)
        return Sample(1000.0 + at_s, busy_s, 0.2 * at_s, 0.05 * at_s, resident)

    figures = Watch([sample(at_s) for at_s in range(331)]).figures(30)
    assert figures == {
        "manager_percent": 10.0,
        "workers_percent": 20.0,
        "vehicles_percent": 5.0,
        "resident_mb": 403.0,
        "growth_mb": 3.0,
    }


@pytest.mark.parametrize("text", ["260", "260:", ":60", "0:60", "260:9", "-1:60", "x:60", "260:60:1"])
def test_a_load_that_is_none_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(click.BadParameter, match="allowed: VEHICLES:SECONDS, from 10 s") as refused:
        Load.parse(text)
    assert "\n" not in refused.value.message


def test_a_figure_is_held_up_to_its_target_and_not_without_one() -> None:
    assert Line("missed", 0, "", 0).row() == "| missed | 0 | <= 0 | yes |"
    assert Line("way", 25.1, " ms", 25.0).row() == "| way | 25.1 ms | <= 25 ms | **no** |"
    assert Line("way", None, " ms", 25.0).row() == "| way | - | <= 25 ms | **no** |"
    assert Line("crossed", 12.0).row() == "| crossed | 12 |  |  |"


@pytest.mark.parametrize(("vehicles", "way_p99_ms"), [(20, 5.0), (60, 5.0), (61, 10.0), (260, 25.0), (520, None)])
def test_the_target_for_a_number_of_vehicles_holds_for_fewer(vehicles: int, way_p99_ms: float | None) -> None:
    lines = {line.name: line for line in measured(vehicles).lines()}
    assert lines["whole way, p99"].most == way_p99_ms
    assert (lines["round trip, p99"].most is None) == (vehicles > 260)
    assert lines["manager and workers, of one core"].value == 65.0
    assert lines["begun late by, p99"].value is None


def test_both_tables_are_written() -> None:
    text = measured(60, missed=2).markdown()
    assert "| control cycles missed | 2 | <= 0 | **no** |" in text
    assert "| ingest | 1 | 4 | 8 | 9 |" in text
    assert measured(60, missed=2).missed == 2


def test_what_nothing_slowed_is_told_and_is_no_target() -> None:
    lines = {line.name: line for line in measured(60).lines()}
    assert lines["a core slow, of the time"].value == 5.1
    assert lines["control cycles in which none was"].value == 93.0
    assert lines["whole way of those, p99"].row() == "| whole way of those, p99 | 3.5 ms |  |  |"
    assert lines["whole way, p99"].row() == "| whole way, p99 | 4 ms | <= 5 ms | yes |"


def test_a_core_was_slow_where_the_same_work_took_more_than_twice_its_median() -> None:
    work = FixedWork(0, [0.00, 0.01, 0.02, 0.03, 0.04, 0.05], [1.0, 1.0, 2.0, 2.1, 1.0, 1.0])
    assert work.slow() == [False, False, False, True, False, False]
    # The slow quantum began at 0.03: what lies beside it is slow, too, for when it became so nobody knows.
    spans = [(0.001, 0.009), (0.012, 0.018), (0.021, 0.029), (0.031, 0.039), (0.041, 0.049)]
    assert work.at_speed(spans) == [True, True, False, False, True]


def test_nobody_knows_of_a_core_before_and_after_it_was_looked_at() -> None:
    assert FixedWork(0).slow() == []
    assert FixedWork(0).at_speed([(0.0, 1.0)]) == [False]
    assert FixedWork(0, [1.0, 1.1], [1.0, 1.0]).at_speed([(0.9, 1.05), (1.01, 1.09), (1.05, 1.2)]) == [
        False,
        True,
        False,
    ]


def test_only_control_cycles_in_time_in_which_no_core_was_slow_count() -> None:
    def core(slow: range) -> FixedWork:
        return FixedWork(0, [0.01 * k for k in range(200)], [9.0 if k in slow else 1.0 for k in range(200)])

    ways = [(0.4, 0.001), (0.6, 0.004), (0.8, 0.004), (1.05, 0.040), (1.3, 0.006), (1.4, 0.050), (1.7, 0.001)]
    cycles, noise = ControlCycles("", ways), [core(range(100, 110)), core(range(136, 140))]
    found = cycles.at_speed(noise, 0.5, 1.5)
    assert (found.slow_percent, found.share_percent) == (3.5, 60.0)
    assert found.whole is not None
    assert (found.whole.p50_ms, found.whole.max_ms) == (4.1, 6.0)
    assert ControlCycles("").at_speed(noise, 0.5, 1.5) == AtSpeed(3.5, 0.0, None)


def test_the_work_is_done_on_the_core_said_and_only_its_thread_stays_there() -> None:
    free = cores()
    with FixedWork(free[-1]) as work:
        while len(work.took_s) < 5:
            assert work._thread.is_alive()
        assert os.sched_getaffinity(work._thread.native_id or 0) == {free[-1]}
        assert cores() == free
    assert all(0.0 < took_s < 0.5 for took_s in work.took_s)
    assert work.at_s == sorted(work.at_s)
    assert not work._thread.is_alive()
