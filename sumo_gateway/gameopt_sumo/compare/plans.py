"""Signal plans: tuned on other arrivals before anything is measured, with the search kept beside them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gameopt_sumo.baselines.plan import Plan
from gameopt_sumo.baselines.search import at_bounds as bounds
from gameopt_sumo.baselines.tuning import PLAN_FILE
from gameopt_sumo.compare.methods import Method
from gameopt_sumo.compare.processes import Processes, last_line
from gameopt_sumo.compare.settings import Settings
from gameopt_sumo.files import read_json

if TYPE_CHECKING:
    from gameopt_sumo.compare.runs import Run


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
    return folder(out, tuning) / PLAN_FILE


def at_bounds(out: Path) -> list[str]:
    """A line for each tuned plan that lies at a bound of its search, where better lights may lie beyond.

    Raises `FileError`.
    """
    found = {file.parent.name: bounds(read_json(file, Plan)) for file in sorted((out / "plans").glob(f"*/{PLAN_FILE}"))}
    return [f"`{name}`: {'; '.join(times)}" for name, times in found.items() if times]


def tune(out: Path, tuning: Tuning, settings: Settings, jobs: int, processes: Processes) -> str | None:
    """Search for the plan, unless it is there; what went wrong, if anything did. Raises `Stopped`."""
    place = folder(out, tuning)
    if (place / PLAN_FILE).exists():  # it is written last, and whole
        return None
    place.mkdir(parents=True, exist_ok=True)
    log = place / "tuning.log"
    command = [sys.executable, "-m", "gameopt_sumo.baselines", "tune", "--method", tuning.control]
    command += ["--flow", f"{tuning.flow_veh_h:g}", "--ratio", f"{tuning.ratio:g}"]
    command += ["--seeds", ",".join(map(str, settings.tuning_seeds)), "--budget", str(settings.tuning_budget)]
    command += ["--duration", f"{settings.duration_s:g}", "--warmup", f"{settings.warmup_s:g}"]
    code = processes.run([*command, "--jobs", str(jobs), "--out", str(place)], log)
    return None if code == 0 and (place / PLAN_FILE).exists() else last_line(log)
