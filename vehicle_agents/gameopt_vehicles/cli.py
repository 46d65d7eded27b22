"""`gameopt-vehicles`: drive a SUMO scenario, or synthetic vehicles, under a running intersection manager."""

from __future__ import annotations

import asyncio
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import click
import uvloop

from gameopt_vehicles.bus import BadBusConfiguration, NoManager
from gameopt_vehicles.drive import DEFAULT_ENDPOINT, MeasuredRoad, complain, drive
from gameopt_vehicles.options import Number, Options, check, parse_aggressiveness, parse_strategy

EXIT_BAD_INPUT = 2
EXIT_NO_MANAGER = 3
_EPILOG = (
    "Exit codes: 0 done; 2 bad arguments or files; 3 no manager answers, or its clock or map differs; "
    "4 vehicles collided."
)
_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command(context_settings={"show_default": True, "max_content_width": 110}, epilog=_EPILOG)
@click.option("--sumo", type=_FILE, metavar="FILE.sumocfg", help="Drive the vehicles of this SUMO scenario.")
@click.option("--synthetic", type=click.IntRange(1, 5000), metavar="N", help="Drive N vehicles without SUMO.")
@click.option(
    "--junction",
    multiple=True,
    metavar="ID",
    help="The junction, where the net (or the network) has several. More than once: vehicles meet a manager at each.",
)
@click.option(
    "--connect",
    multiple=True,
    metavar="EP",
    help=f"Zenoh endpoint of the manager.  [default: {DEFAULT_ENDPOINT}]",
)
@click.option("--zenoh-config", type=_FILE, metavar="FILE", help="Zenoh configuration to use instead (JSON5).")
@click.option("--clock", type=click.Choice(["wall", "lockstep"]), default="wall", help="As the manager's.")
@click.option("--duration", type=Number(0.1, 1e6), default=300.0, metavar="S", help="Simulated seconds in all.")
@click.option("--warmup", type=Number(0.0, 1e6), default=0.0, metavar="S", help="Of these, not measured, s.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=1, metavar="N", help="Seed of all randomness.")
@click.option(
    "--report",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.json",
    help="Write the report here.",
)
@click.option("--loss", type=Number(0.0, 1.0), default=0.0, metavar="P", help="Share of messages lost, each way.")
@click.option("--delay-ms", type=Number(0.0, 6e4), default=0.0, metavar="D", help="Delay of a message, ms, each way.")
@click.option("--jitter-ms", type=Number(0.0, 6e4), default=0.0, metavar="J", help="Delay varies by +- J ms.")
@click.option("--ignore-turn-speed", is_flag=True, help="Turn at the lane's limit.")
@click.option("--articulated", is_flag=True, help="Allow bodies up to 18.75 m by 2.6 m, else up to 12 m by 2.55 m.")
@click.option(
    "--tracking-noise",
    type=Number(0.0, 10.0),
    default=0.0,
    metavar="MPS",
    help="Sigma of each speed driven around the speed aimed at, m/s.",
)
@click.option("--inflate", type=Number(0.0, 10.0), default=0.0, metavar="M", help="Count bodies this near, m each.")
@click.option(
    "--strategy",
    callback=parse_strategy,
    default="truthful",
    metavar="NAME",
    help="truthful, overbid or shade:FACTOR.",
)
@click.option(
    "--aggressiveness",
    callback=parse_aggressiveness,
    metavar="CLASS=D,...",
    help="Private aggressiveness d, 0 to 1, of all vehicles of a class (SUMO's vClass); else each draws its own.",
)
@click.option("--gui", is_flag=True, help="Show SUMO's window.")
@click.version_option(package_name="gameopt")
@click.argument("sumo_options", nargs=-1, type=click.UNPROCESSED, metavar="[-- SUMO OPTIONS]")
def command(**values: Any) -> int:
    """Drive independent, bidding vehicles under a running gameopt-im."""
    options = Options(**values)
    check(options)
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        if options.sumo is None:
            return runner.run(drive(options, None))
        try:
            from gameopt_sumo.simulation import SimulationError  # only now: libsumo takes its time to load
        except ImportError as error:
            raise click.ClickException(f"SUMO lacks a system library: {error}; the README names them") from None
        try:
            return runner.run(drive(options, partial(_roads, options, options.sumo)))
        except SimulationError as error:
            raise click.ClickException(str(error)) from None


def _roads(options: Options, sumocfg: Path) -> list[MeasuredRoad]:
    """The scenario, loaded, as each of its junctions sees it; libsumo starts only when it is asked for."""
    from gameopt_sumo.simulation import simulations

    return [
        *simulations(
            sumocfg,
            options.junction or (None,),
            options.seed,
            gui=options.gui,
            extra_args=options.sumo_options,
            ignore_turn_speed=options.ignore_turn_speed,
            inflate_m=options.inflate,
            articulated=options.articulated,
        )
    ]


def main() -> None:
    """The command: every failure that is not a bug is one line on stderr and an exit code."""
    try:
        code = command.main(prog_name="gameopt-vehicles", standalone_mode=False)
    except click.exceptions.Abort:
        code = 128 + signal.SIGINT
    except click.ClickException as error:
        complain(error.format_message())
        code = EXIT_BAD_INPUT
    except NoManager as error:
        complain(str(error))
        code = EXIT_NO_MANAGER
    except BadBusConfiguration as error:
        complain(str(error))
        code = EXIT_BAD_INPUT
    sys.exit(code)
