"""How long decisions take: measured one after the other on an idle machine, then read together."""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track

from gameopt_sumo.compare.processes import BIN, Processes, last_line
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


class Joint(NamedTuple):
    """Medians over recorded states of one size: the joint MIQP by SCIP, and the paper's auction with its programs.

    `proven` is the share of states whose optimum was proven within the limit; for the others the limit is the time.
    `factor` is how many times longer the joint program takes: at least so many where not all is proven. `excess` is
    by what share the auction's objective is above the optimum, where that was proven.
    """

    vehicles: int
    states: int
    proven: float
    joint_ms: float
    auction_ms: float
    full_rows_ms: float
    factor: float
    excess: float | None


@dataclass(frozen=True)
class Computation:
    """What was measured, and what went wrong by step."""

    decisions: list[Decision] = field(default_factory=list)
    joint: list[Joint] = field(default_factory=list)
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
        if self.joint:
            shown["joint MIQP, median"] = [(j.vehicles, j.joint_ms) for j in self.joint]
            shown["paper's auction and QPs, median"] = [(j.vehicles, j.auction_ms) for j in self.joint]
            shown["the same on full rows"] = [(j.vehicles, j.full_rows_ms) for j in self.joint]
        return shown


def measure(out: Path, processes: Processes, console: Console) -> None:
    """Record, measure decisions, and solve recorded states to the optimum; what is there is not done again."""
    folder = out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FAILED).unlink(missing_ok=True)
    failed: dict[str, str] = {}
    steps = {RECORDING: _record, BENCH: _bench, OPTIMAL: _optimal}
    missing = [name for name in steps if not (folder / name).exists()]
    for name in track(missing, "computation", console=console):
        reason = _step(steps[name], folder, name, processes)
        if reason is not None:
            failed[name] = reason
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
    joint = [_joint(size["vehicles"], size["states"]) for size in _json(folder / OPTIMAL).get("sizes", [])]
    return Computation(decisions, joint, _json(folder / FAILED))


def _joint(vehicles: int, states: list[dict[str, Any]]) -> Joint:
    def median_ms(name: str) -> float:
        return 1000.0 * statistics.median(float(state[name]) for state in states)

    proven = [state for state in states if state["solved"]]
    excesses = [state["auction"] / state["optimal"] - 1.0 for state in proven if state["optimal"]]
    return Joint(
        vehicles=vehicles,
        states=len(states),
        proven=len(proven) / len(states),
        joint_ms=median_ms("optimal_s"),
        auction_ms=median_ms("auction_s"),
        full_rows_ms=median_ms("full_rows_s"),
        factor=statistics.median(float(state["optimal_s"]) / float(state["auction_s"]) for state in states),
        excess=statistics.median(excesses) if excesses else None,
    )


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
