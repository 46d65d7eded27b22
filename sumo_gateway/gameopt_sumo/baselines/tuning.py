"""Tuning the lights for a demand: the search, and the record it leaves.

What counts as better is what a fair opponent would want: that nobody collides, then that vehicles are served, counted
as the unserved of every seed beyond the five that a measuring window may leave behind at its end, then the mean time
from scheduled departure to goal, the wait upstream of the control zone included (the mean total delay, but for a
constant). Tune on seeds that are not reported on. Every plan that was looked at is kept with its figures.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from gameopt_sumo.baselines.plan import BaselineError, Kind, Plan, write_plan
from gameopt_sumo.baselines.search import Score, search, starts
from gameopt_sumo.baselines.trial import Trial
from gameopt_sumo.files import read_json, write_whole
from gameopt_sumo.scenarios import FourArm, write_four_arm

SEARCH_FILE, PLAN_FILE, SETTINGS_FILE = "search.jsonl", "plan.json", "settings.json"
LEFT_BEHIND = 5
"""As many unserved vehicles at the end of a run count as none."""


class Looked(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the record: a plan and how it did."""

    number: int
    plan: Plan
    collisions: int
    """Over all seeds."""
    unserved: float
    """Beyond `LEFT_BEHIND`, mean over the seeds."""
    mean_time_s: float
    by_seed: tuple[Trial, ...]

    @property
    def score(self) -> Score:
        return self.collisions, self.unserved, self.mean_time_s


@dataclass(frozen=True)
class Tuning:
    """A search for one demand, and its folder."""

    demand: FourArm
    """Its seed and duration are replaced by those below."""
    method: Kind
    seeds: tuple[int, ...]
    duration_s: float
    warmup_s: float
    out: Path

    def configs(self) -> list[Path]:
        """The scenarios of the seeds, written again: the same parameters give the same bytes."""
        return [
            write_four_arm(replace(self.demand, seed=seed, duration_s=self.duration_s), self.out / f"seed-{seed}")
            for seed in self.seeds
        ]

    def settings(self) -> dict[str, Any]:
        """What a record belongs to; the budget may grow."""
        demand = self.demand
        return {
            "arm_flows_veh_h": list(demand.flow_by_arm_veh_h.values()),
            "turns": list(demand.turns),
            "classes": dict(demand.classes),
            "lanes": demand.lanes,
            "method": self.method,
            "seeds": list(self.seeds),
            "duration_s": self.duration_s,
            "warmup_s": self.warmup_s,
        }


def tune(
    demand: FourArm,
    method: Kind,
    seeds: Sequence[int],
    budget: int,
    duration_s: float,
    warmup_s: float,
    jobs: int,
    out: Path,
) -> Path:
    """Look at `budget` plans for `demand`, `jobs` at a time; the file with the best.

    Every plan drives the arrivals of all `seeds`. A plan already in the folder's record is not tried again, so an
    interrupted search goes on where it was. Raises `BaselineError`, also for a folder that belongs to another search,
    and `FileError`.
    """
    tuning = Tuning(demand, method, tuple(seeds), duration_s, warmup_s, out)
    out.mkdir(parents=True, exist_ok=True)
    _claim(out / SETTINGS_FILE, tuning.settings())
    record = _Record(tuning, jobs)
    known = search(demand, starts(demand, method), budget, record.evaluate)
    file = out / PLAN_FILE
    write_plan(min(known, key=known.__getitem__), file)
    return file


def _claim(file: Path, settings: dict[str, Any]) -> None:
    """A folder holds one search."""
    if not file.exists():
        write_whole(file, msgspec.json.format(msgspec.json.encode(settings), indent=2) + b"\n")
        return
    kept = read_json(file, dict[str, Any])
    different = next((name for name, value in settings.items() if kept.get(name) != value), None)
    if different is not None:
        raise BaselineError(
            f"{file.parent}: holds a search with {different} {kept.get(different)}, "
            f"not {settings[different]}; choose another folder"
        )


class _Record:
    """The plans looked at so far, on disk as well."""

    def __init__(self, tuning: Tuning, jobs: int) -> None:
        self._tuning = tuning
        self._jobs = jobs
        self._configs = tuning.configs()
        self._file = tuning.out / SEARCH_FILE
        self._known = {looked.plan: looked for looked in read_search(self._file)}

    def evaluate(self, plans: Sequence[Plan]) -> list[Score]:
        """Their scores, each from the record or by trying it."""
        new = [plan for plan in plans if plan not in self._known]
        pool = ThreadPoolExecutor(self._jobs)
        try:
            for plan, trials in zip(new, pool.map(self._try, new), strict=True):
                self._keep(plan, trials)
        finally:
            pool.shutdown(cancel_futures=True)  # when interrupted, begin no other
        return [self._known[plan].score for plan in plans]

    def _keep(self, plan: Plan, trials: Sequence[Trial]) -> None:
        looked = Looked(
            number=len(self._known),
            plan=plan,
            collisions=sum(trial.collisions for trial in trials),
            unserved=statistics.fmean(max(0, trial.unserved - LEFT_BEHIND) for trial in trials),
            mean_time_s=round(statistics.fmean(trial.mean_time_s for trial in trials), 3),
            by_seed=tuple(trials),
        )
        self._known[plan] = looked
        with self._file.open("ab") as file:
            file.write(msgspec.json.encode(looked) + b"\n")

    def _try(self, plan: Plan) -> list[Trial]:
        """One process for all the seeds; libsumo has one simulation at a time."""
        tuning = self._tuning
        command = [sys.executable, "-m", "gameopt_sumo.baselines", "try", *map(str, self._configs)]
        times = ["--duration", str(tuning.duration_s), "--warmup", str(tuning.warmup_s)]
        seeds = ["--seeds", ",".join(map(str, tuning.seeds))]
        text = msgspec.json.encode(plan)
        done = subprocess.run([*command, *times, *seeds], input=text, capture_output=True, check=False)
        if done.returncode != 0:
            said = done.stderr.decode(errors="replace").strip().splitlines()
            raise BaselineError(f"{tuning.out}: a trial failed: {said[-1] if said else done.returncode}; plan {text!r}")
        return msgspec.json.decode(done.stdout, type=list[Trial])


def read_search(file: Path) -> list[Looked]:
    """The record; a last line that an interruption cut short is cut off. Raises `BaselineError`."""
    if not file.exists():
        return []
    text = file.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if whole != text:
        file.write_bytes(whole)
    try:
        return [msgspec.json.decode(line, type=Looked) for line in whole.splitlines()]
    except msgspec.DecodeError as error:
        raise BaselineError(f"{file}: not the record of a search: {error}") from None
