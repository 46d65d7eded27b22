"""The load test's own arithmetic: shares of a core, growth of memory, and what counts as held."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
import pytest

sys.path.append(str(Path(__file__).parents[1] / "load"))
from live import MB, Line, Load, Measured, Sample, Watch
from machine import Evenness, evenness

ALONE = Evenness(4.0, 6.0)
SPREAD = {"p50_ms": 1.0, "p99_ms": 4.0, "p999_ms": 8.0, "max_ms": 9.0}


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
    return Measured(Load(vehicles, 60), 1, report(missed), used | {"resident_mb": 400.0, "growth_mb": 0.5}, ALONE)


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


def test_the_machine_alone_is_measured_in_milliseconds_of_a_small_job() -> None:
    alone = evenness(0.5)
    assert 0.2 < alone.p50_ms <= alone.p99_ms < 500.0
