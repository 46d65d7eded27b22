"""Signal plans: tuned on other arrivals before anything is measured, with the search kept beside them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gameopt_sumo.compare.methods import Method
from gameopt_sumo.compare.processes import Processes, last_line
from gameopt_sumo.compare.settings import Settings

if TYPE_CHECKING:
    from gameopt_sumo.compare.runs import Run

PLAN = "plan.json"


class Tuning(NamedTuple):
    """Lights to be tuned: `fixed` or `actuated`, at this demand."""

    control: str
    flow_veh_h: float
    ratio: float


def needed(run: Run, method: Method) -> Tuning:
    """The tuning whose plan a run of lights uses."""
    assert method.control is not None
    assert run.flow_veh_h is not None
    assert run.ratio is not None
    return Tuning(method.control, run.flow_veh_h, 1.0 if method.plan == "even" else run.ratio)


def folder(out: Path, tuning: Tuning) -> Path:
    """Where the plan and the search for it are kept."""
    return out / "plans" / f"{tuning.control}-{tuning.flow_veh_h:g}-ratio{tuning.ratio:g}"


def plan_file(out: Path, tuning: Tuning) -> Path:
    """The plan."""
    return folder(out, tuning) / PLAN


def tune(out: Path, tuning: Tuning, settings: Settings, jobs: int, processes: Processes) -> str | None:
    """Search for the plan, unless it is there; what went wrong, if anything did. Raises `Stopped`."""
    place = folder(out, tuning)
    if (place / PLAN).exists():
        return None
    place.mkdir(parents=True, exist_ok=True)
    log = place / "tuning.log"
    command = [sys.executable, "-m", "gameopt_sumo.baselines", "tune", "--method", tuning.control]
    command += ["--flow", f"{tuning.flow_veh_h:g}", "--ratio", f"{tuning.ratio:g}"]
    command += ["--seeds", ",".join(map(str, settings.tuning_seeds)), "--budget", str(settings.tuning_budget)]
    command += ["--duration", f"{settings.duration_s:g}", "--warmup", f"{settings.warmup_s:g}"]
    code = processes.run([*command, "--jobs", str(jobs), "--out", str(place)], log)
    return None if code == 0 and (place / PLAN).exists() else last_line(log)
