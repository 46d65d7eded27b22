"""Results folders of made-up runs; no test in here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gameopt_sumo.compare.runs import FAILED, MANAGER, REPORT, RUN, Place, Run
from gameopt_sumo.compare.settings import Settings
from gameopt_sumo.compare.sources import versions

SETTINGS = Settings(versions=versions(), duration_s=40.0, warmup_s=10.0, tuning_budget=4)
PID = 4711


def report(**figures: Any) -> dict[str, Any]:
    """A whole report; `figures` by dotted path with __ for the dot, e.g. time_to_goal_s__mean=10.0."""
    made: dict[str, Any] = {
        "schema": "gameopt-report/1",
        "duration_s": 40.0,
        "warmup_s": 10.0,
        "method": "as the vehicles call it",
        "vehicles": {"arrived": 50, "entered": 49, "crossed": 45, "in_zone": 4, "waiting_to_enter": 1},
        "throughput_veh_min": 90.0,
        "time_to_goal_s": {"mean": 12.0, "p50": 11.0, "p95": 15.0, "max": 20.0},
        "fuel_g": 15.0,
        "co2_g": 45.0,
        "fuel_total_g": 675.0,
        "co2_total_g": 2025.0,
        "by_class": {"truck": {"count": 5, "time_to_goal_s": 13.0, "fuel_g": 50.0, "co2_g": 150.0}},
        "safety": {"collisions_sumo": 0, "collisions_geometric": 0, "min_pet_s": 0.5, "hard_brakes": 0, "teleports": 0},
        "control_cycle": {"count": 300, "missed": 0, "p50_ms": 3.0, "p99_ms": 6.0, "max_ms": 8.0},
    }
    for name, value in figures.items():
        inner = made
        *outer, last = name.split("__")
        for part in outer:
            inner = inner.setdefault(part, {})
        inner[last] = value
    return made


def put(out: Path, run: Run, made: dict[str, Any] | None = None, failed: str | None = None) -> Path:
    """A run's folder as `perform` leaves it; its folder."""
    folder = Place(out, SETTINGS).folder(run)
    folder.mkdir(parents=True)
    (folder / RUN).write_text(json.dumps({name: getattr(run, name) for name in run.__struct_fields__}))
    if made is not None:
        (folder / REPORT).write_text(json.dumps(made))
        (folder / MANAGER).write_text(json.dumps({"manager_pid": PID}))
    if failed is not None:
        (folder / FAILED).write_text(json.dumps({"reason": failed}))
    return folder


def run(method: str = "coop", flow_veh_h: float = 10000.0, ratio: float = 1.0, seed: int = 101, **knob: Any) -> Run:
    """A run of the four-arm junction."""
    return Run(method=method, flow_veh_h=flow_veh_h, ratio=ratio, seed=seed, **knob)
