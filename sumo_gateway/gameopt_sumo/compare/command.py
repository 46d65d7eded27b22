"""`gameopt-sumo compare`: the command line, checked and complete before anything is run."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gameopt_sumo.exit_codes import EXIT_COLLIDED, EXIT_FAILED

if TYPE_CHECKING:
    from gameopt_sumo.compare.experiments import Experiment
    from gameopt_sumo.compare.runs import Place, Run

COMMANDS = "commands.txt"
EXPERIMENTS = ("flows", "unbalanced", "preferences", "ablation", "computation", "drift")
_EPILOG = (
    "A folder is added to: what is whole in it is not run again, and results of other settings are refused. "
    "Exit codes: 0 done; 1 runs failed; 2 bad arguments, files or folder; 4 vehicles collided under our manager."
)


def _listed(convert: Callable[[str], Any], what: str) -> Callable[..., tuple[Any, ...] | None]:
    """A callback that reads `2000,4000` as a tuple."""

    def read(_context: click.Context, option: click.Parameter, text: str | None) -> tuple[Any, ...] | None:
        if text is None:
            return None
        try:
            return tuple(dict.fromkeys(convert(part.strip()) for part in text.split(",")))
        except ValueError:
            raise click.BadParameter(f"{text!r}; allowed: {what}, separated by commas", param=option) from None

    return read


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number


_NUMBERS = _listed(_finite, "numbers")


@click.command(epilog=_EPILOG, context_settings={"max_content_width": 110})
@click.option("--experiment", type=click.Choice(EXPERIMENTS), help="Methods, flows, ratios by name; options override.")
@click.option("--methods", callback=_listed(str, "methods"), metavar="M,M,...", help="NAME, or NAME@areas, NAME@box.")
@click.option("--flows", callback=_NUMBERS, metavar="VEH_H,...", help="Total flows, veh/h.")
@click.option("--ratios", callback=_NUMBERS, metavar="R,...", show_default="1",
              help="Flow of W and E over that of N and S.")  # fmt: skip
@click.option("--seeds", type=click.IntRange(1, 99), default=3, metavar="N", help="N seeds, one after the other.")
@click.option("--first-seed", type=click.IntRange(0, 2**31 - 100), default=101, metavar="N",
              help="The first; the defaults were chosen on 101 to 110, lights are tuned on 201 and 202.")  # fmt: skip
@click.option("--duration", "duration_s", type=click.FloatRange(1.0, 86400.0), default=360.0, metavar="S",
              help="Simulated seconds, warm-up included.")  # fmt: skip
@click.option("--warmup", "warmup_s", type=click.FloatRange(0.0), default=60.0, metavar="S",
              help="Of these, not measured, s.")  # fmt: skip
@click.option("--geometry", type=click.Choice(["areas", "box"]), default="areas", help="Of methods without their own.")
@click.option("--ignore-turn-speed", is_flag=True, help="Our methods turn at the lane's limit.")
@click.option("--sumo", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE.sumocfg",
              help="A net and arrivals of your own; not for lights that have to be tuned.")  # fmt: skip
@click.option("--junction", metavar="ID", help="The junction, where the net of --sumo has several.")
@click.option("--tuning-budget", type=click.IntRange(1, 100_000), default=80, metavar="N",
              help="Signal plans tried for each demand before the lights are frozen.")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 256), metavar="N", show_default="half the cores",
              help="Runs at a time; one of ours is two processes.")  # fmt: skip
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
              help="Results folder.")  # fmt: skip
def compare(**options: Any) -> int:
    """Compare methods on the same arrivals: results, plots and a page with the paper's claims in DIR."""
    from gameopt_sumo.compare.methods import MethodError
    from gameopt_sumo.compare.settings import SettingsError
    from gameopt_sumo.run_files import SimulationError

    try:
        return _compare(**options)
    except (MethodError, SettingsError, SimulationError) as error:
        raise click.ClickException(str(error)) from None


def _compare(out: Path, jobs: int | None, sumo: Path | None, **options: Any) -> int:
    from rich.console import Console

    from gameopt_sumo.compare import computation, schedule
    from gameopt_sumo.compare.processes import Processes, cores
    from gameopt_sumo.compare.runs import Place
    from gameopt_sumo.compare.settings import alone, claim

    experiment, runs = _runs(sumo, **options)
    settings = _settings(sumo, **options)
    console, processes = Console(stderr=True), Processes(apart=True)
    place = Place(out, settings)
    with alone(out):
        claim(out, settings)
        _note_command(out)
        try:
            with schedule.interruptible(processes):
                run_now = schedule.carry_out(place, runs, jobs or max(1, cores() // 2), processes, console)
                if experiment.computation:
                    computation.measure(place, processes, console)
        except KeyboardInterrupt:
            whole = sum(map(place.done, runs))
            click.echo(f"interrupted: {whole} of {len(runs)} runs are whole; the same command goes on", err=True)
            raise
        return _conclude(place, runs, run_now, experiment.computation)


def _runs(
    sumo: Path | None,
    *,
    seeds: int,
    first_seed: int,
    experiment: str | None,
    methods: tuple[str, ...] | None,
    flows: tuple[float, ...] | None,
    ratios: tuple[float, ...] | None,
    **_: Any,
) -> tuple[Experiment, list[Run]]:
    from gameopt_sumo.compare.experiments import Experiment, check_knobs, check_seeds, experiments, runs_of
    from gameopt_sumo.compare.methods import check_goes_with, named
    from gameopt_sumo.scenarios import FourArm

    if sumo is not None and (flows or ratios):
        raise click.UsageError("--sumo brings its own arrivals: leave out --flows and --ratios")
    chosen = experiments()[experiment] if experiment else Experiment()
    chosen = replace(
        chosen,
        methods=methods or chosen.methods,
        flows_veh_h=flows or chosen.flows_veh_h,
        ratios=ratios or chosen.ratios,
    )
    if not chosen.computation and not (chosen.methods and (chosen.flows_veh_h or sumo)):
        raise click.UsageError("give --methods and --flows, or --experiment, or --methods and --sumo")
    with_names = [named(name) for name in chosen.methods]
    for method in with_names:
        check_goes_with(method, sumo)
    check_knobs(chosen, with_names, sumo is not None)
    check_seeds(first_seed, seeds, with_names)
    for flow in chosen.flows_veh_h:
        for ratio in chosen.ratios:
            FourArm(flow_veh_h=flow, ratio=ratio)  # refuses what is not allowed
    return chosen, runs_of(chosen, with_names, seeds, sumo is not None, first_seed)


def _settings(
    sumo: Path | None,
    *,
    junction: str | None,
    ignore_turn_speed: bool,
    tuning_budget: int,
    duration_s: float,
    warmup_s: float,
    geometry: Any,
    **_: Any,
) -> Any:
    from gameopt_sumo.compare.settings import Settings, digest
    from gameopt_sumo.compare.sources import versions
    from gameopt_sumo.network import read_map
    from gameopt_sumo.run_files import net_file_of

    if junction is not None and sumo is None:
        raise click.UsageError("--junction: allowed only with --sumo FILE.sumocfg")
    digested = None
    if sumo is not None:
        read_map(net_file_of(sumo), junction)  # refuses a junction that cannot be managed before anything is run
        digested = digest(sumo)
    return Settings(
        versions=versions(),
        duration_s=duration_s,
        warmup_s=warmup_s,
        geometry=geometry,
        turn_speed=not ignore_turn_speed,
        tuning_budget=tuning_budget,
        sumo=None if sumo is None else str(sumo.resolve()),
        sumo_digest=digested,
        junction=junction,
    )


def _conclude(place: Place, runs: list[Run], run_now: int, computation_asked: bool) -> int:
    """Write everything that can be read off the folder; the exit code of what was asked for."""
    from gameopt_sumo.compare import computation, page, plans, plots, results
    from gameopt_sumo.compare.methods import named
    from gameopt_sumo.files import write_whole

    out = place.out
    entries = results.gather(out, place.settings)
    computed = computation.read(out)
    results.write(out, entries)
    made = page.Made(_commands(out), datetime.now(UTC), plots.draw(out, entries, computed), plans.at_bounds(out))
    write_whole(out / "report.md", page.page(entries, place.settings, computed, made).encode())
    asked = {run.name for run in runs}
    mine = [entry for entry in entries if entry["run"] in asked]
    failed = [entry["run"] for entry in mine if entry["failed"] is not None]
    collided = [entry["run"] for entry in results.collided(mine) if named(entry["method"]).ours]
    click.echo(f"{len(runs)} runs, {len(runs) - run_now} of them were there; {out / 'report.md'}")
    if failed:
        click.echo(f"failed: {', '.join(failed)}", err=True)
    if collided:
        click.echo(f"vehicles collided: {', '.join(collided)}", err=True)
        return EXIT_COLLIDED
    return EXIT_FAILED if failed or (computation_asked and computed is not None and computed.failed) else 0


def _note_command(out: Path) -> None:
    """Keep this command line beside those that have added to the folder, unless it is there; before anything runs."""
    from gameopt_sumo.files import write_whole

    commands = dict.fromkeys((*_commands(out), shlex.join(["gameopt-sumo", *sys.argv[1:]])))
    write_whole(out / COMMANDS, ("\n".join(commands) + "\n").encode())


def _commands(out: Path) -> list[str]:
    """The command lines that have added to the folder."""
    file = out / COMMANDS
    return file.read_text(encoding="utf-8").splitlines() if file.exists() else []
