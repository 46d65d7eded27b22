"""How long decisions take: measured one after the other on an idle machine, then read together."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from rich.console import Console
from rich.progress import track

from gameopt_sumo.compare.processes import (
    BIN,
    MANAGER_LOG,
    VEHICLES_LOG,
    Machine,
    ProcessError,
    Processes,
    last_line,
    machine,
)
from gameopt_sumo.compare.runs import FAILED, MACHINE, Place
from gameopt_sumo.compare.settings import Settings, SettingsError
from gameopt_sumo.exit_codes import EXIT_COLLIDED
from gameopt_sumo.files import read_json, write_whole
from gameopt_sumo.scenarios import FourArm, write_four_arm

T = TypeVar("T")

FOLDER = "computation"
RECORDING, BENCH, OPTIMAL = "recording.mcap", "bench.json", "optimal.json"
VEHICLES = (10, 20, 50, 100, 200, 260)
CYCLES = 1000
RECORDED_FLOW_VEH_H, RECORDED_S = 16000.0, 120.0
"""So busy that there are states of 40 vehicles and more without a clearance; at 10,000 veh/h there are 14."""
SEED = 102
_TERMS: dict[str, Callable[[Any], Any]] = {"n": lambda n: n, "n log2 n": lambda n: n * np.log2(n), "n^2": np.square}
"""What decision time may grow with, n being the number of vehicles."""


class Decision(NamedTuple):
    """Decision time of the auction and the programs, snapshot in, commands out."""

    vehicles: float
    p50_ms: float
    p99_ms: float


class Growth(NamedTuple):
    """The least-squares fit  t = constant + slope term(n)  of the medians, ms, and its R^2."""

    term: str
    constant_ms: float
    slope_ms: float
    r_squared: float

    def at(self, vehicles: float) -> float:
        """The fit, ms."""
        return self.constant_ms + self.slope_ms * float(_TERMS[self.term](vehicles))


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
    ended: str | None = None
    """Why the joint program was not tried on more vehicles; None while it is, or where nobody says."""
    machine: Machine | None = None

    @property
    def growths(self) -> list[Growth]:
        """The fits of n, n log2 n and n^2, from three numbers of vehicles on: which fits best is for R^2 to say."""
        return [_fit(self.decisions, term) for term in _TERMS] if len(self.decisions) >= 3 else []

    def lines(self) -> dict[str, list[tuple[float, float]]]:
        """By label, time in ms against vehicles."""
        shown = {
            "decision, median": [(d.vehicles, d.p50_ms) for d in self.decisions],
            "decision, 99th percentile": [(d.vehicles, d.p99_ms) for d in self.decisions],
        }
        if growths := self.growths:
            best = max(growths, key=lambda growth: growth.r_squared)
            shown[f"{best.term} fitted to the median"] = [(d.vehicles, best.at(d.vehicles)) for d in self.decisions]
        if self.joint:
            shown["joint MIQP, median"] = [(j.vehicles, j.joint_ms) for j in self.joint]
            shown["paper's auction and QPs, median"] = [(j.vehicles, j.auction_ms) for j in self.joint]
            shown["the same on full rows"] = [(j.vehicles, j.full_rows_ms) for j in self.joint]
        return shown


def check(settings: Settings) -> None:
    """Refuse a folder of other settings than decisions are measured with. Raises `SettingsError`."""
    if settings.geometry != "areas" or not settings.turn_speed:
        given = "--ignore-turn-speed" if settings.geometry == "areas" else "--geometry box"
        raise SettingsError(f"computation is measured on areas at turning speeds: leave out {given}, for another --out")


def measure(place: Place, processes: Processes, console: Console) -> None:
    """Record, measure decisions, and solve recorded states to the optimum; what is there is not done again.

    Raises `SettingsError`, `FileError` and `Stopped`.
    """
    check(place.settings)
    folder = place.out / FOLDER
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
        write_whole(folder / FAILED, msgspec.json.encode(failed))


Step = Callable[[Path, Path, Processes], int]
"""Makes the file that is its second argument; its exit code."""


def _step(do: Step, folder: Path, name: str, processes: Processes) -> str | None:
    """One step, whose file is there whole or not at all; what went wrong."""
    path = folder / name
    partial = path.with_name(f"part-{name}")
    if name != OPTIMAL:
        partial.unlink(missing_ok=True)  # the optima that are there are gone on from
    write_whole(folder / MACHINE, msgspec.json.encode(machine()))
    try:
        code = do(folder, partial, processes)
    except ProcessError as error:
        return str(error)
    if code != 0 or not partial.exists():
        return last_line(folder / f"{path.stem}.log", folder / VEHICLES_LOG, folder / MANAGER_LOG)
    partial.rename(path)
    return None


def _record(folder: Path, path: Path, processes: Processes) -> int:
    demand = FourArm(flow_veh_h=RECORDED_FLOW_VEH_H, seed=SEED, duration_s=RECORDED_S)
    config = write_four_arm(demand, folder / "arrivals")
    lockstep = ["--clock", "lockstep"]
    drive = [*lockstep, "--sumo", config, "--duration", RECORDED_S, "--seed", SEED]
    path.with_name(f"part-{OPTIMAL}").unlink(missing_ok=True)  # of another recording
    code = processes.two([*lockstep, "--record", path], drive, folder).code
    return 0 if code == EXIT_COLLIDED else code  # its states are as good


def _bench(folder: Path, path: Path, processes: Processes) -> int:
    figures = ["--vehicles", ",".join(map(str, VEHICLES)), "--cycles", CYCLES, "--no-ratios", "--json", path]
    return processes.run([BIN / "gameopt-im", "bench", *figures], folder / "bench.log")


def _optimal(folder: Path, path: Path, processes: Processes) -> int:
    command = [sys.executable, "-m", "gameopt_im.optimal", folder / RECORDING, "--json", path]
    return processes.run(command, folder / "optimal.log")


class _Stage(msgspec.Struct):
    p50: float
    p99: float


class _Stages(msgspec.Struct):
    decision: _Stage


class _Measured(msgspec.Struct):
    vehicles: float
    stages_ms: _Stages


class _Bench(msgspec.Struct):
    """What is read of the figures of `gameopt-im bench`."""

    measured: list[_Measured]


class _State(msgspec.Struct):
    solved: bool
    optimal_s: float
    optimal: float | None
    auction_s: float
    auction: float
    full_rows_s: float


class _Size(msgspec.Struct):
    vehicles: int
    states: Annotated[list[_State], Meta(min_length=1)]


class _Optimal(msgspec.Struct):
    """What is read of the figures of `gameopt_im.optimal`."""

    sizes: list[_Size]
    ended: str | None


def read(out: Path) -> Computation | None:
    """What the folder has of it; None if it was never measured. Raises `FileError`."""
    folder = out / FOLDER
    if not folder.is_dir():
        return None
    bench = _kept(folder / BENCH, _Bench, _Bench([]))
    optimal = _kept(folder / OPTIMAL, _Optimal, _Optimal([], None))
    return Computation(
        decisions=[_decision(each) for each in bench.measured],
        joint=[_joint(size.vehicles, size.states) for size in optimal.sizes],
        failed=_kept(folder / FAILED, dict[str, str], {}),
        ended=optimal.ended,
        machine=read_json(folder / MACHINE, Machine) if (folder / MACHINE).exists() else None,
    )


def _kept(path: Path, kind: type[T], otherwise: T) -> T:
    return read_json(path, kind) if path.exists() else otherwise


def _decision(measured: _Measured) -> Decision:
    decision = measured.stages_ms.decision
    return Decision(measured.vehicles, decision.p50, decision.p99)


def _joint(vehicles: int, states: list[_State]) -> Joint:
    def median_ms(name: str) -> float:
        return 1000.0 * statistics.median(float(getattr(state, name)) for state in states)

    proven = [state for state in states if state.solved]
    excesses = [state.auction / state.optimal - 1.0 for state in proven if state.optimal]
    return Joint(
        vehicles=vehicles,
        states=len(states),
        proven=len(proven) / len(states),
        joint_ms=median_ms("optimal_s"),
        auction_ms=median_ms("auction_s"),
        full_rows_ms=median_ms("full_rows_s"),
        factor=statistics.median(state.optimal_s / state.auction_s for state in states),
        excess=statistics.median(excesses) if excesses else None,
    )


def _fit(decisions: list[Decision], term: str) -> Growth:
    vehicles = np.array([d.vehicles for d in decisions])
    times = np.array([d.p50_ms for d in decisions])
    terms = np.column_stack((np.ones(len(vehicles)), _TERMS[term](vehicles)))
    (constant, slope), *_ = np.linalg.lstsq(terms, times)
    left = times - terms @ np.array([constant, slope])
    spread = float(np.sum((times - times.mean()) ** 2))
    return Growth(term, float(constant), float(slope), 1.0 - float(left @ left) / spread if spread else 1.0)
