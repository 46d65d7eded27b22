"""gameopt-sumo: write scenarios, read maps, compare methods."""

from __future__ import annotations

import math
import signal
import sys
from pathlib import Path
from typing import Any

import click

from gameopt_sumo.compare.command import compare
from gameopt_sumo.exit_codes import EXIT_BAD_INPUT
from gameopt_sumo.files import FileError, complaint
from gameopt_sumo.network import NetworkError, map_json, read_map
from gameopt_sumo.scenarios import FourArm, ScenarioError, write_four_arm


def _numbers(context: click.Context, option: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    """`.25,.5,.25` as (0.25, 0.5, 0.25), as many as the metavar names."""
    del context
    if value is None:
        return None
    names = option.metavar or ""
    try:
        numbers = tuple(float(part) for part in value.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != len(names.split(",")) or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"{value!r} is not numbers {names}", param=option)
    return numbers


def _shares(context: click.Context, option: click.Parameter, value: str) -> dict[str, float]:
    """`car=.9,truck=.1` as {"car": 0.9, "truck": 0.1}."""
    del context
    shares: dict[str, float] = {}
    for part in value.split(","):
        name, _, share = part.partition("=")
        try:
            shares[name.strip()] = float(share)
        except ValueError:
            message = f"{part!r} is not NAME=SHARE, e.g. car=.85,truck=.12,emergency=.03"
            raise click.BadParameter(message, param=option) from None
    return shares


@click.group(no_args_is_help=False, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
def command() -> None:
    """SUMO, the road: write scenarios, read a net as an intersection map, compare methods on the same arrivals."""


command.add_command(compare)


@command.group(no_args_is_help=False)
def scenario() -> None:
    """Write a scenario: one net, one demand, one .sumocfg."""


@scenario.command("four-arm")
@click.option("--flow", "flow_veh_h", type=float, default=6000.0, metavar="VEH_H", help="Total flow, veh/h.")
@click.option("--ratio", type=float, default=1.0, metavar="R", help="Flow of W and E over that of N and S.")
@click.option(
    "--arm-flows",
    "arm_flows_veh_h",
    callback=_numbers,
    metavar="W,E,N,S",
    help="Flow from each arm, veh/h; replaces --flow and --ratio.",
)
@click.option(
    "--turns",
    callback=_numbers,
    default=".25,.5,.25",
    metavar="R,S,L",
    help="Shares that turn right, go straight, turn left.",
)
@click.option(
    "--classes",
    callback=_shares,
    default="car=.85,truck=.12,emergency=.03",
    metavar="NAME=SHARE,...",
    help="Shares of the vehicle classes car, truck, emergency, taxi.",
)
@click.option("--lanes", type=int, default=3, metavar="1-3", help="Lanes per approach.")
@click.option("--seed", type=int, default=1, metavar="N", help="Seed of the arrivals.")
@click.option(
    "--duration", "duration_s", type=float, default=3600.0, metavar="S", help="Departures up to this time, s."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default="four-arm",
    help="Directory to write to.",
)
def four_arm(out: Path, **parameters: Any) -> None:
    """Four arms, 150 m control zone, 20 m/s, Poisson arrivals; prints the .sumocfg."""
    click.echo(write_four_arm(FourArm(**parameters), out))


@command.command("map")
@click.argument("net", type=click.Path(path_type=Path), metavar="FILE.net.xml")
@click.option("--junction", metavar="ID", help="The junction; needed if several have crossing movements.")
@click.option("--articulated", is_flag=True, help="For bodies up to 18.75 m by 2.6 m too, else up to 12 m by 2.55 m.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="File to write; else stdout.")
def write_map(net: Path, junction: str | None, articulated: bool, out: Path | None) -> None:
    """Read a SUMO net as an intersection map: movements, groups, conflict areas (JSON, lengths in m)."""
    text = map_json(read_map(net, junction, articulated=articulated))
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        out.write_bytes(text)
    except OSError as error:
        raise click.FileError(str(out), error.strerror) from None


def main() -> None:
    """The command: whatever is wrong with the input is one line on stderr and exit code 2."""
    try:
        code = command.main(standalone_mode=False) or 0
    except click.exceptions.Abort:
        code = 128 + signal.SIGINT
    except click.ClickException as error:
        code = _complain(error.format_message())
    except (FileError, NetworkError, ScenarioError) as error:
        code = _complain(str(error))
    except OSError as error:
        code = _complain(complaint(error))
    sys.exit(code)


def _complain(message: str) -> int:
    click.echo(f"gameopt-sumo: {' '.join(message.split())}", err=True)
    return EXIT_BAD_INPUT
