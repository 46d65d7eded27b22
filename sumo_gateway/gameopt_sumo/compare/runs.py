"""One run: a method on the arrivals of one flow, ratio and seed, and the folder it leaves its report in."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from gameopt_sumo.baselines.report import SCHEMA
from gameopt_sumo.compare import plans
from gameopt_sumo.compare.methods import Method, named
from gameopt_sumo.compare.processes import MANAGER_LOG, VEHICLES_LOG, ProcessError, Processes, last_line, machine
from gameopt_sumo.compare.settings import Settings
from gameopt_sumo.exit_codes import EXIT_COLLIDED
from gameopt_sumo.files import write_whole
from gameopt_sumo.run_files import net_file_of
from gameopt_sumo.scenarios import CONFIG_FILE, NET_FILE, FourArm, write_four_arm

RUN, REPORT, MANAGER, FAILED, MACHINE = "run.json", "report.json", "manager.json", "failed.json", "machine.json"
PROBE = "taxi"
PROBE_SHARE = 0.1
"""Cars with an aggressiveness of their own are a class of their own, so that the report shows them apart."""
KNOBS = ("aggressiveness", "lambda", "trucks", "noise")
"""What can be varied beside the demand: the probes' aggressiveness, the program's lambda, the share of trucks, and
the error of the speed driven, m/s."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """Flow in veh/h; flow and ratio are None on a net of the user's own, `knob` and `value` where none is turned."""

    method: str
    flow_veh_h: float | None = None
    ratio: float | None = None
    seed: int
    knob: str | None = None
    value: float | None = None

    @property
    def name(self) -> str:
        """The name of its folder."""
        demand = "" if self.flow_veh_h is None else f"-{self.flow_veh_h:g}-ratio{self.ratio:g}"
        turned = "" if self.knob is None else f"-{self.knob}{self.value:g}"
        return f"{self.method.replace('@', '-')}{demand}{turned}-seed{self.seed}"

    def knob_is(self, name: str) -> float | None:
        """The knob's value, if it is this one."""
        return self.value if self.knob == name else None


class Failure(msgspec.Struct, frozen=True):
    """Why a run has no report."""

    reason: str


@dataclass(frozen=True)
class Place:
    """The results folder: where arrivals, plans and runs are."""

    out: Path
    settings: Settings

    def folder(self, run: Run) -> Path:
        """Of one run."""
        return self.out / "runs" / run.name

    def done(self, run: Run) -> bool:
        """Whether its report is there and whole."""
        return read_report(self.folder(run) / REPORT, self.settings.duration_s) is not None

    def scenario(self, run: Run) -> Path:
        """The .sumocfg with its arrivals, which every method shares."""
        if self.settings.sumo is not None:
            return Path(self.settings.sumo)
        made = f"{run.flow_veh_h:g}-ratio{run.ratio:g}-seed{run.seed}"
        if run.knob in ("trucks", "aggressiveness"):
            made += f"-{run.knob}" + ("" if run.knob == "aggressiveness" else f"{run.value:g}")
        return self.out / "arrivals" / made / CONFIG_FILE

    def make_scenario(self, run: Run) -> None:
        """Write the arrivals, unless they are there. Raises `ScenarioError`."""
        config = self.scenario(run)
        if self.settings.sumo is None and not config.exists():
            assert run.flow_veh_h is not None
            assert run.ratio is not None
            partial = config.parent.with_name(config.parent.name + ".part")
            demand = FourArm(
                flow_veh_h=run.flow_veh_h,
                ratio=run.ratio,
                classes=_classes(run),
                seed=run.seed,
                duration_s=self.settings.duration_s,
            )
            write_four_arm(demand, partial)
            partial.rename(config.parent)


def _classes(run: Run) -> dict[str, float]:
    shares = dict(FourArm().classes)
    if (trucks := run.knob_is("trucks")) is not None:
        shares |= {"truck": trucks, "car": 1.0 - shares["emergency"] - trucks}
    if run.knob == "aggressiveness":
        shares |= {PROBE: PROBE_SHARE, "car": shares["car"] - PROBE_SHARE}
    return shares


def perform(run: Run, place: Place, processes: Processes, jobs: int = 1) -> None:
    """Run it, one of `jobs` at a time, and leave its report, or why there is none. Raises `Stopped`, `FileError`."""
    folder = place.folder(run)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (REPORT, FAILED, MANAGER, MACHINE):
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / RUN, msgspec.json.encode(run))
    write_whole(folder / MACHINE, msgspec.json.encode(machine(jobs)))
    partial = folder / "report.part.json"
    partial.unlink(missing_ok=True)
    try:
        method = named(run.method)
        drive = _ours if method.ours else _by_sumo
        code = drive(run, method, place, partial, processes)
        if code not in (0, EXIT_COLLIDED) or read_report(partial, place.settings.duration_s) is None:
            raise ProcessError(last_line(folder / VEHICLES_LOG, folder / MANAGER_LOG))
    except ProcessError as error:
        write_whole(folder / FAILED, msgspec.json.encode(Failure(str(error))))
        return
    partial.rename(folder / REPORT)


def _ours(run: Run, method: Method, place: Place, report: Path, processes: Processes) -> int:
    """Manager and vehicles in lock-step over Zenoh."""
    settings, folder, config = place.settings, place.folder(run), place.scenario(run)
    serve: list[Any] = ["--clock", "lockstep", "--workers", "1", "--geometry", method.geometry or settings.geometry]
    net = config.with_name(NET_FILE) if settings.sumo is None else net_file_of(config)
    serve += ["--map", net]
    if method.profile is not None:
        serve += ["--profile", method.profile]
    if (trade_off := run.knob_is("lambda")) is not None:
        (folder / "im.toml").write_text(f"[program]\nlambda = {trade_off!r}\n")
        serve += ["--config", folder / "im.toml"]
    elif method.configuration is not None:
        serve += ["--config", method.configuration]
    drive: list[Any] = ["--clock", "lockstep", "--sumo", config, *_timing(run, settings), "--report", report]
    if (noise := run.knob_is("noise")) is not None:
        drive += ["--tracking-noise", noise]
    if (aggressiveness := run.knob_is("aggressiveness")) is not None:
        drive += ["--aggressiveness", f"{PROBE}={aggressiveness!r}"]
    both: list[Any] = [] if settings.turn_speed else ["--ignore-turn-speed"]
    both += ["--junction", settings.junction] if settings.junction is not None else []
    ran = processes.two([*serve, *both], [*drive, *both], folder)
    write_whole(folder / MANAGER, msgspec.json.encode({"manager_pid": ran.manager_pid}))
    return ran.code


def _by_sumo(run: Run, method: Method, place: Place, report: Path, processes: Processes) -> int:
    """A control of SUMO's own, in a process of its own."""
    settings = place.settings
    assert method.control is not None
    command: list[Any] = [sys.executable, "-m", "gameopt_sumo.baselines", "run", place.scenario(run)]
    command += ["--method", method.control, "--name", method.name]
    if method.plan is not None:
        command += ["--plan", plans.plan_file(place.out, plans.needed(run, method))]
    if settings.junction is not None:
        command += ["--junction", settings.junction]
    command += [*_timing(run, settings), "--report", report]
    return processes.run(command, place.folder(run) / VEHICLES_LOG)


def _timing(run: Run, settings: Settings) -> list[Any]:
    return ["--duration", settings.duration_s, "--warmup", settings.warmup_s, "--seed", run.seed]


def read_report(path: Path, duration_s: float) -> dict[str, Any] | None:
    """A report that is there, of the schema we know, and of a run that went to its end; else None."""
    try:
        report: dict[str, Any] = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        return None
    whole = report.get("schema") == SCHEMA and report.get("duration_s", 0.0) >= duration_s - 0.05
    return report if whole else None
