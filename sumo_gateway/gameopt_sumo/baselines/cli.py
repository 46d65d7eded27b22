"""The baselines' command: one measured run, and the search for the best lights."""

from __future__ import annotations

import math
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
import msgspec

from gameopt_sumo.baselines.plan import BaselineError, Kind, Plan, PlanError, read_plan
from gameopt_sumo.exit_codes import EXIT_BAD_INPUT, EXIT_COLLIDED
from gameopt_sumo.files import FileError, complaint
from gameopt_sumo.network import NetworkError
from gameopt_sumo.run_files import SimulationError, net_file_of
from gameopt_sumo.scenarios import FourArm, ScenarioError

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_SEED = click.IntRange(0, 2**31 - 1)
_Command = TypeVar("_Command", bound=Callable[..., Any])


def _finite(context: click.Context, option: click.Parameter, value: float) -> float:
    """NaN passes every range."""
    if not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number", context, option)
    return value


def _seeds(context: click.Context, option: click.Parameter, value: str) -> tuple[int, ...]:
    """`201,202` as (201, 202)."""
    try:
        seeds = tuple(int(part) for part in value.split(","))
    except ValueError:
        seeds = ()
    if not seeds or min(seeds) < 0 or len(set(seeds)) < len(seeds):
        raise click.BadParameter(f"{value!r} is not different whole numbers N,N,...", context, option)
    return seeds


def _number(
    name: str, least: float, most: float, default: float, unit: str, text: str
) -> Callable[[_Command], _Command]:
    kind = click.FloatRange(least, most)
    return click.option(name, type=kind, default=default, metavar=unit, callback=_finite, help=text)


_duration = _number("--duration", 0.1, 1e6, 300.0, "S", "Simulated seconds in all, warm-up included.")
_warmup = _number("--warmup", 0.0, 1e6, 60.0, "S", "Of these, not measured, s.")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
def command() -> None:
    """What SUMO's own controls make of a scenario, measured as our own method is."""


@command.command()
@click.argument("config", type=_FILE, metavar="FILE.sumocfg")
@click.option(
    "--method",
    type=click.Choice(["fixed", "actuated", "all-way-stop", "own"]),
    required=True,
    help="Lights with a plan, an all-way stop, or whatever the net has itself.",
)
@click.option("--junction", metavar="ID", help="The junction, where the net has several.")
@click.option("--plan", type=_FILE, metavar="PLAN.json", help="The plan of the lights (fixed, actuated).")
@click.option("--name", metavar="NAME", help="The method's name in the report.  [default: the method]")
@click.option("--seed", type=_SEED, default=1, metavar="N", help="SUMO's seed.")
@_duration
@_warmup
@_number("--inflate", 0.0, 10.0, 0.0, "M", "Count bodies this near, m each.")
@click.option(
    "--report", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE.json", help="The report."
)
def run(config: Path, method: str, plan: Path | None, name: str | None, report: Path, **values: Any) -> int:
    """Drive FILE.sumocfg under one of SUMO's own controls and write the report; exit 4 if vehicles collided."""
    if values["warmup"] >= values["duration"]:
        raise click.UsageError(f"--warmup {values['warmup']:g} must be below --duration {values['duration']:g}")
    if (plan is not None) != (method in ("fixed", "actuated")):
        raise click.UsageError("--plan is needed for --method fixed and actuated, and for these alone")
    from gameopt_sumo.baselines.report import assemble  # only now: libsumo takes its time to load
    from gameopt_sumo.baselines.watch import Run, watch

    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        driven = Run(
            config=config,
            net=_net(config, method, values["junction"], plan, Path(scratch)),
            junction=values["junction"],
            seed=values["seed"],
            duration_s=values["duration"],
            warmup_s=values["warmup"],
            inflate_m=values["inflate"],
        )
        made = assemble(name or method, watch(driven, _on_signal()))
    try:
        report.write_bytes(made.to_json())
    except OSError as error:
        raise click.FileError(str(report), error.strerror) from None
    if made.collided():
        _complain("vehicles collided; see the report")
        return EXIT_COLLIDED
    return 0


def _net(config: Path, method: str, junction: str | None, plan: Path | None, scratch: Path) -> Path | None:
    """The net of the method; None for the scenario's own."""
    from gameopt_sumo.baselines import nets

    out = scratch / "net.xml"
    if plan is not None:
        kind: Kind = "fixed" if method == "fixed" else "actuated"
        try:
            nets.lights(net_file_of(config), junction, read_plan(plan, kind), out)
        except PlanError as error:
            raise BaselineError(f"{plan}: {error}") from None
        return out
    if method == "all-way-stop":
        nets.all_way_stop(net_file_of(config), junction, out)
        return out
    return None


def _on_signal() -> Any:
    """Whether SIGINT or SIGTERM has come: the run then ends, with the report of what was driven."""
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _frame: came.append(got))
    return lambda: bool(came)


@command.command()
@_number("--flow", 1.0, 40_000.0, 6000.0, "VEH_H", "Total flow, veh/h.")
@_number("--ratio", 0.01, 100.0, 1.0, "R", "Flow of W and E over that of N and S.")
@click.option("--method", type=click.Choice(["fixed", "actuated"]), required=True, help="What to tune.")
@click.option("--seeds", callback=_seeds, default="201,202", metavar="N,N", help="Seeds of the arrivals tuned on.")
@click.option("--budget", type=click.IntRange(1, 100_000), default=80, metavar="N", help="Plans looked at.")
@_duration
@_warmup
@click.option("--jobs", type=click.IntRange(1, 256), default=1, metavar="J", help="Plans tried at a time.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, metavar="DIR", help="Folder.")
def tune(flow: float, ratio: float, method: Kind, out: Path, **values: Any) -> int:
    """Search the best lights for a four-arm demand; prints the plan's file. Interrupted, it goes on where it was."""
    from gameopt_sumo.baselines.tuning import tune as search

    demand = FourArm(flow_veh_h=flow, ratio=ratio)
    times = (values["duration"], values["warmup"])
    if times[1] >= times[0]:
        raise click.UsageError(f"--warmup {times[1]:g} must be below --duration {times[0]:g}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    click.echo(search(demand, method, values["seeds"], values["budget"], *times, values["jobs"], out))
    return 0


@command.command("try", hidden=True)
@click.argument("configs", type=_FILE, nargs=-1, required=True)
@click.option("--seeds", callback=_seeds, required=True)
@_duration
@_warmup
def try_plan(configs: tuple[Path, ...], seeds: tuple[int, ...], duration: float, warmup: float) -> int:
    """One step of `tune`: a plan on stdin, how it did on each scenario on stdout."""
    from gameopt_sumo.baselines.nets import lights
    from gameopt_sumo.baselines.trial import drive
    from gameopt_sumo.scenarios import DEMAND_FILE

    plan = msgspec.json.decode(sys.stdin.buffer.read(), type=Plan)
    with tempfile.TemporaryDirectory(prefix="gameopt-") as scratch:
        net = Path(scratch, "net.xml")
        lights(net_file_of(configs[0]), None, plan, net)  # the seeds' nets are one
        trials = [
            drive(config, net, config.with_name(DEMAND_FILE), seed, duration, warmup)
            for config, seed in zip(configs, seeds, strict=True)
        ]
    click.echo(msgspec.json.encode(trials))
    return 0


def main() -> None:
    """The command: whatever is wrong with the input is one line on stderr and exit code 2."""
    try:
        code = command.main(prog_name="gameopt_sumo.baselines", standalone_mode=False)
    except click.exceptions.Abort:
        code = 128 + signal.SIGINT
    except click.ClickException as error:
        code = _complain(error.format_message())
    except (BaselineError, FileError, NetworkError, ScenarioError, SimulationError) as error:
        code = _complain(str(error))
    except OSError as error:
        code = _complain(complaint(error))
    sys.exit(code)


def _complain(message: str) -> int:
    click.echo(f"gameopt_sumo.baselines: {' '.join(message.split())}", err=True)
    return EXIT_BAD_INPUT
