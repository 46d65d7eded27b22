"""`results.json` and `results.csv`: one entry per run, and what several seeds say together."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from scipy import stats

from gameopt_sumo.baselines.report import Report
from gameopt_sumo.compare.runs import FAILED, MACHINE, MANAGER, REPORT, RUN, Failure, Run, read_report
from gameopt_sumo.compare.settings import Settings
from gameopt_sumo.figures import COLLISIONS
from gameopt_sumo.files import read_json, write_whole

Entry = dict[str, Any]
OWN_FIELDS = ("run", "knob", "value", "manager_pid", "machine", "failed")
"""What an entry has beside the report: the run's folder, what was varied, the manager's process, the machine and how
many runs at a time it had, why it failed."""


class Figure(NamedTuple):
    """Mean over seeds, half of its 95 % interval (None from one seed), and the number of seeds that have the figure."""

    mean: float
    half: float | None
    seeds: int

    def seeds_of(self, runs: int) -> str:
        """`2 of 3` where not every run has the figure, else `3`."""
        return f"{self.seeds}" if self.seeds == runs else f"{self.seeds} of {runs}"


def gather(out: Path, settings: Settings) -> list[Entry]:
    """Every run of the folder that went to its end or failed, in order; interrupted ones are not in it.

    Raises `FileError`.
    """
    found = []
    for path in sorted((out / "runs").glob(f"*/{RUN}")):
        run, folder = read_json(path, Run), path.parent
        if (report := read_report(folder / REPORT, settings.duration_s)) is not None:
            manager, machine = (_kept(folder / name) for name in (MANAGER, MACHINE))
            found.append((run, _entry(run, report, manager_pid=manager.get("manager_pid"), machine=machine or None)))
        elif (folder / FAILED).exists():
            found.append((run, _entry(run, {}, failed=read_json(folder / FAILED, Failure).reason)))
    found.sort(key=lambda pair: _order(pair[0]))
    return [{name: entry.get(name) for name in (*Report.__struct_fields__, *OWN_FIELDS)} for _, entry in found]


def _kept(path: Path) -> dict[str, Any]:
    return read_json(path, dict[str, Any]) if path.exists() else {}


def _entry(run: Run, report: dict[str, Any], **own: Any) -> Entry:
    return {
        **report,
        "method": run.method,
        "flow_veh_h": report.get("flow_veh_h") if run.flow_veh_h is None else run.flow_veh_h,
        "ratio": report.get("ratio") if run.ratio is None else run.ratio,
        "seed": run.seed,
        "run": run.name,
        "knob": run.knob,
        "value": run.value,
        **own,
    }


def _order(run: Run) -> tuple[Any, ...]:
    return (run.knob or "", run.value or 0.0, run.ratio or 0.0, run.flow_veh_h or 0.0, run.method, run.seed)


def write(out: Path, entries: Sequence[Entry]) -> None:
    """Both files."""
    write_whole(out / "results.json", msgspec.json.format(msgspec.json.encode(entries), indent=2) + b"\n")
    write_whole(out / "results.csv", table(entries).encode())


def table(entries: Sequence[Entry]) -> str:
    """The entries as CSV, nested fields as `time_to_goal_s.mean`."""
    flat = [dict(_flat(entry)) for entry in entries]
    columns = list(dict.fromkeys(name for row in flat for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()


def _flat(entry: Entry, prefix: str = "") -> Iterable[tuple[str, Any]]:
    for name, value in entry.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        elif value is not None or not prefix:
            yield f"{prefix}{name}", value


def at(entry: Entry, path: str) -> float | None:
    """A figure of an entry by its dotted path; None where it lacks one."""
    value: Any = entry
    for name in path.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def whole(entries: Iterable[Entry], **having: Any) -> list[Entry]:
    """The runs that went to their end and have these fields. Nothing else is ever averaged."""
    return [e for e in entries if e["failed"] is None and all(e[name] == value for name, value in having.items())]


def figure(entries: Sequence[Entry], path: str) -> Figure | None:
    """Mean and 95 % interval (Student's t) of a figure over runs that differ by their seed alone."""
    return _of_values([value for entry in entries if (value := at(entry, path)) is not None])


def _of_values(values: Sequence[float]) -> Figure | None:
    if not values:
        return None
    half = None
    if len(values) > 1:
        half = float(stats.t.ppf(0.975, len(values) - 1)) * statistics.stdev(values) / math.sqrt(len(values))
    return Figure(statistics.fmean(values), half, len(values))


def change(entries: Sequence[Entry], against: Sequence[Entry], path: str) -> Figure | None:
    """By how much a figure differs, seed by seed: 0.25 is a quarter more than `against`."""
    return _of_values([mine / other - 1.0 for mine, other in _pairs(entries, against, path) if other])


def difference(entries: Sequence[Entry], against: Sequence[Entry], path: str) -> Figure | None:
    """How much more a figure is than under `against`, seed by seed, in its own unit."""
    return _of_values([mine - other for mine, other in _pairs(entries, against, path)])


def _pairs(entries: Sequence[Entry], against: Sequence[Entry], path: str) -> Iterable[tuple[float, float]]:
    others = {entry["seed"]: at(entry, path) for entry in against}
    for entry in entries:
        mine, other = at(entry, path), others.get(entry["seed"])
        if mine is not None and other is not None:
            yield mine, other


def collided(entries: Iterable[Entry]) -> list[Entry]:
    """Runs, under whatever control, in which any count saw a collision or a teleport."""
    counts = [f"safety.{name}" for name in COLLISIONS]
    return [e for e in whole(entries) if any(at(e, name) for name in counts)]
