"""How long decisions take: measured one after the other on an idle machine, then read together."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track

from gameopt_sumo.compare.processes import BIN, Processes, Stopped, last_line
from gameopt_sumo.scenarios import FourArm, write_four_arm

FOLDER = "computation"
RECORDING, BENCH, OPTIMAL, FAILED = "recording.mcap", "bench.json", "optimal.json", "failed.json"
VEHICLES = (10, 20, 50, 100, 200, 260)
CYCLES = 1000
RECORDED_FLOW_VEH_H, RECORDED_S = 10000.0, 120.0
SEED = 102


class Decision(NamedTuple):
    """Decision time of the auction and the programs, snapshot in, commands out."""

    vehicles: float
    p50_ms: float
    p99_ms: float


class Growth(NamedTuple):
    """The least-squares fit  t = constant + slope n log2 n  of the medians, ms, and its R^2."""

    constant_ms: float
    slope_ms: float
    r_squared: float

    def at(self, vehicles: float) -> float:
        """The fit, ms."""
        return self.constant_ms + self.slope_ms * vehicles * math.log2(vehicles)


@dataclass(frozen=True)
class Computation:
    """What was measured; `optimal` is what `gameopt_im.optimal` wrote, `failed` what went wrong by step."""

    decisions: list[Decision] = field(default_factory=list)
    optimal: dict[str, Any] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    @property
    def growth(self) -> Growth | None:
        """The n log n that fits, from three numbers of vehicles on."""
        return _fit(self.decisions) if len(self.decisions) >= 3 else None

    def lines(self) -> dict[str, list[tuple[float, float]]]:
        """By label, time in ms against vehicles."""
        shown = {
            "decision, median": [(d.vehicles, d.p50_ms) for d in self.decisions],
            "decision, 99th percentile": [(d.vehicles, d.p99_ms) for d in self.decisions],
        }
        if (growth := self.growth) is not None:
            shown["n log n fitted to the median"] = [(d.vehicles, growth.at(d.vehicles)) for d in self.decisions]
        return shown


def measure(out: Path, console: Console) -> None:
    """Record, measure decisions, and solve recorded states to the optimum; what is there is not done again."""
    folder = out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FAILED).unlink(missing_ok=True)
    failed: dict[str, str] = {}
    processes = Processes(apart=True)
    steps = {RECORDING: _record, BENCH: _bench, OPTIMAL: _optimal}
    missing = [name for name in steps if not (folder / name).exists()]
    try:
        for name in track(missing, "computation", console=console):
            reason = _step(steps[name], folder, name, processes)
            if reason is not None:
                failed[name] = reason
    except KeyboardInterrupt:
        processes.stop()
        raise
    if failed:
        (folder / FAILED).write_bytes(msgspec.json.encode(failed))


Step = Callable[[Path, Path, Processes], int]


def _step(do: Step, folder: Path, name: str, processes: Processes) -> str | None:
    """One step, whose file is there whole or not at all; what went wrong."""
    path = folder / name
    partial = path.with_name(f"part-{name}")
    partial.unlink(missing_ok=True)
    code = do(folder, partial, processes)
    if code != 0 or not partial.exists():
        return last_line(folder / f"{path.stem}.log", folder / "vehicles.log", folder / "manager.log")
    partial.rename(path)
    return None


def _record(folder: Path, path: Path, processes: Processes) -> int:
    demand = FourArm(flow_veh_h=RECORDED_FLOW_VEH_H, seed=SEED, duration_s=RECORDED_S)
    config = write_four_arm(demand, folder / "arrivals")
    lockstep = ["--clock", "lockstep"]
    drive = [*lockstep, "--sumo", config, "--duration", RECORDED_S, "--seed", SEED]
    return processes.two([*lockstep, "--record", path], drive, folder).code


def _bench(folder: Path, path: Path, processes: Processes) -> int:
    figures = ["--vehicles", ",".join(map(str, VEHICLES)), "--cycles", CYCLES, "--json", path]
    return processes.run([BIN / "gameopt-im", "bench", *figures], folder / "bench.log")


def _optimal(folder: Path, path: Path, processes: Processes) -> int:
    command = [sys.executable, "-m", "gameopt_im.optimal", folder / RECORDING, "--json", path]
    return processes.run(command, folder / "optimal.log")


def read(out: Path) -> Computation | None:
    """What the folder has of it; None if it was never measured."""
    folder = out / FOLDER
    if not folder.is_dir():
        return None
    bench = _json(folder / BENCH).get("measured", [])
    decisions = [
        Decision(m["vehicles"], m["stages_ms"]["decision"]["p50"], m["stages_ms"]["decision"]["p99"]) for m in bench
    ]
    return Computation(decisions, _json(folder / OPTIMAL), _json(folder / FAILED))


def _json(path: Path) -> dict[str, Any]:
    return dict(msgspec.json.decode(path.read_bytes())) if path.exists() else {}


def _fit(decisions: list[Decision]) -> Growth:
    vehicles = np.array([d.vehicles for d in decisions])
    times = np.array([d.p50_ms for d in decisions])
    terms = np.column_stack((np.ones(len(vehicles)), vehicles * np.log2(vehicles)))
    (constant, slope), *_ = np.linalg.lstsq(terms, times)
    left = times - terms @ np.array([constant, slope])
    spread = float(np.sum((times - times.mean()) ** 2))
    return Growth(float(constant), float(slope), 1.0 - float(left @ left) / spread if spread else 1.0)
