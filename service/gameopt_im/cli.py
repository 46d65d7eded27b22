"""The command `gameopt-im`. Whatever is wrong with what it was given is one line on stderr and exit 2."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import Any

import click
import uvloop

from gameopt_im import config, heap, logs, map_file
from gameopt_im.options import DEFAULT_ENDPOINT, ServeOptions, StartError
from gameopt_im.web import address
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Geometry, Profile

BAD_INPUT = 2
DIFFERENT = 1
MOST_WORKERS = 64
MOST_VEHICLES = 2000
FILE = click.Path(path_type=Path, dir_okay=False)


def main() -> None:
    """The entry point."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs one command line; its exit code. Never a traceback for what the user got wrong."""
    from gameopt_sumo.network import NetworkError

    try:
        return int(commands.main(list(arguments), "gameopt-im", standalone_mode=False, obj=arguments) or 0)
    except click.ClickException as error:
        return _refuse(error.format_message())
    except (StartError, NetworkError) as error:
        return _refuse(str(error))
    except click.Abort:  # interrupted before the loop listened for signals
        return 0


def _refuse(why: str) -> int:
    click.echo(f"gameopt-im: {' '.join(why.split())}", err=True)
    return BAD_INPUT


@click.group(no_args_is_help=False)
@click.version_option(package_name="gameopt", prog_name="gameopt-im")
def commands() -> None:
    """The intersection manager: an auction and quadratic programs every 100 ms, in place of lights."""


@commands.command(context_settings={"show_default": True})
@click.option("--config", "config_file", type=FILE, help="Parameters, TOML (docs/configuration.md).")
@click.option(
    "--map",
    "map_path",
    type=FILE,
    show_default="the packaged four-arm map",
    help="The intersection: FILE.net.xml of SUMO, or FILE.json by `gameopt-sumo map`.",
)
@click.option("--junction", metavar="ID", help="Junction of a net that has several.")
@click.option("--articulated", is_flag=True, help="For bodies up to 18.75 m by 2.6 m too, else up to 12 m by 2.55 m.")
@click.option(
    "--listen",
    metavar="ENDPOINT",
    multiple=True,
    show_default=f"{DEFAULT_ENDPOINT} without --connect",
    help="Zenoh endpoint that vehicles connect to; may be repeated.",
)
@click.option(
    "--connect",
    metavar="ENDPOINT",
    multiple=True,
    show_default=False,
    help="Zenoh endpoint of an existing network to join; may be repeated.",
)
@click.option(
    "--zenoh-config",
    type=FILE,
    help="Zenoh's own configuration, JSON5; --listen and --connect replace its endpoints.",
)
@click.option(
    "--clock",
    type=click.Choice(["wall", "lockstep"]),
    default="wall",
    help="Control cycles every 100 ms of the wall clock, or when the simulator has announced a step.",
)
@click.option(
    "--profile",
    type=click.Choice(["default", "paper"]),
    default="default",
    help="The planner, or the paper taken literally.",
)
@click.option(
    "--geometry",
    type=click.Choice(["areas", "box"]),
    show_default="areas; box under --profile paper",
    help="Conflict areas, or the whole zone for every conflicting pair.",
)
@click.option("--ignore-turn-speed", is_flag=True, help="No limit of speed on turns.")
@click.option(
    "--candidates",
    type=click.IntRange(1, 64),
    metavar="K",
    show_default="one per weight vector",
    help="Candidate sequences, at most the number of weight vectors (auction.weights).",
)
@click.option(
    "--workers",
    type=click.IntRange(0, MOST_WORKERS),
    metavar="N",
    default=1,
    help="Processes that solve candidates; 0 solves them in this one.",
)
@click.option(
    "--http",
    metavar="HOST:PORT",
    callback=lambda _context, _option, text: _address(text),
    show_default=f"{address.DEFAULT}, if it is free",
    help="Metrics and health, /metrics, /healthz and /readyz; off for none. Whoever reaches it can read it.",
)
@click.option("--record", type=FILE, metavar="FILE.mcap", help="Record every control cycle to this file.")
@click.option("--log-format", type=click.Choice(["text", "json"]), default="text", help="Lines to read, or JSON.")
def serve(
    *,
    config_file: Path | None,
    map_path: Path | None,
    junction: str | None,
    articulated: bool,
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    zenoh_config: Path | None,
    profile: Profile,
    geometry: Geometry | None,
    ignore_turn_speed: bool,
    candidates: int | None,
    **as_given: Any,
) -> None:
    """Manage one intersection until SIGINT or SIGTERM."""
    parameters = config.load(config_file)
    config.check_profile(parameters, profile, str(config_file))
    options = ServeOptions(
        map=read_map(map_path, junction, articulated=articulated),
        parameters=parameters,
        profile=profile,
        geometry=_geometry(profile, geometry),
        turn_speed=not ignore_turn_speed,
        candidates=_candidates(candidates, len(parameters.auction.weights)),
        listen=listen or (() if connect or zenoh_config else (DEFAULT_ENDPOINT,)),
        connect=connect,
        zenoh_config=zenoh_config,
        command_line=tuple(click.get_current_context().obj),
        **as_given,
    )
    logs.configure(options.log_format)
    heap.share_one()
    from gameopt_im.service import serve as run_service  # compiles the core: not before the input is sound

    run_until_signal(run_service(options))


@commands.command(context_settings={"show_default": True})
@click.option(
    "--vehicles",
    default="50,100,200,260",
    metavar="N,N,...",
    callback=lambda _context, _option, text: _counts(text),
    help="Numbers of vehicles to make up traffic of.",
)
@click.option(
    "--map", "map_path", type=FILE, show_default="the packaged four-arm map", help="Where: FILE.net.xml or FILE.json."
)
@click.option("--recording", type=FILE, multiple=True, show_default=False, help="Measure on this FILE.mcap, too.")
@click.option(
    "--config", "config_file", type=FILE, show_default=False, help="Parameters, TOML (docs/configuration.md)."
)
@click.option("--candidates", type=click.IntRange(1, 64), metavar="K", default=8, help="Candidate sequences.")
@click.option("--workers", type=click.IntRange(0, MOST_WORKERS), metavar="N", default=1, help="Solver processes.")
@click.option("--cycles", type=click.IntRange(1), default=2000, help="Control cycles of each number of vehicles.")
@click.option(
    "--ratios/--no-ratios",
    default=True,
    help="Also compare in turn: workers, the paper's way, full rows, solver set-ups, other solvers; most of the time.",
)
@click.option("--json", "json_file", type=FILE, metavar="FILE", show_default=False, help="Write the figures here.")
def bench(
    *,
    vehicles: tuple[int, ...],
    map_path: Path | None,
    config_file: Path | None,
    recording: tuple[Path, ...],
    candidates: int,
    workers: int,
    cycles: int,
    ratios: bool,
    json_file: Path | None,
) -> None:
    """Measure how long decisions take, stage by stage, without a network; a quarter of an hour."""
    import msgspec
    from rich.console import Console

    logs.configure("text")
    parameters = config.load(config_file)
    service = msgspec.structs.replace(parameters.service, max_vehicles=MOST_VEHICLES)
    parameters = msgspec.structs.replace(parameters, service=service)  # all that are asked for are to be managed
    options = ServeOptions(
        map=read_map(map_path, None),
        parameters=parameters,
        candidates=_candidates(candidates, len(parameters.auction.weights)),
        workers=workers,
        clock="lockstep",  # so that every program is waited for, however long it takes
    )
    from gameopt_im import bench as benchmark

    with _runner() as runner:
        results = runner.run(benchmark.run(benchmark.Bench(options, vehicles, recording, cycles, ratios)))
    for table in benchmark.tables(results):
        Console().print(table)
    if json_file is not None:
        try:
            json_file.write_bytes(msgspec.json.format(msgspec.json.encode(results)))
        except OSError as error:
            raise StartError(f"{json_file}: {error.strerror or error}") from None


def _counts(text: str) -> tuple[int, ...]:
    """Numbers of vehicles, separated by commas."""
    try:
        counts = tuple(int(part) for part in text.split(","))
    except ValueError:
        counts = ()
    if not counts or min(counts) < 1 or max(counts) > MOST_VEHICLES:
        raise click.BadParameter(f"{text!r}; allowed: whole numbers from 1 to {MOST_VEHICLES}, separated by commas")
    return counts


@commands.command()
@click.argument("recording", type=FILE, metavar="FILE.mcap")
def replay(recording: Path) -> None:
    """Run recorded control cycles again; exit 1 at the first command that differs."""
    from gameopt_im.recorder import read
    from gameopt_im.replay import replay as run_again

    logs.configure("text")
    recorded = read(recording)
    with _runner() as runner:
        done = runner.run(run_again(recorded))
    if done.difference is None:
        click.echo(f"{done.cycles} control cycles, every command as recorded")
        return
    click.echo(str(done.difference))
    click.get_current_context().exit(DIFFERENT)


def read_map(path: Path | None, junction: str | None, *, articulated: bool = False) -> IntersectionMap:
    """The map of a .net.xml or .json file, or the packaged one. Raises `NetworkError` or `MapError`."""
    from gameopt_sumo import network

    if path is not None and path.suffix != ".json":
        return network.read_map(path, junction, articulated=articulated)
    for option, given in (("--junction", junction is not None), ("--articulated", articulated)):
        if given:
            raise click.UsageError(f"{option}: allowed only with --map FILE.net.xml")
    return network.packaged_map() if path is None else map_file.read(path)


def _geometry(profile: Profile, geometry: Geometry | None) -> Geometry:
    if profile == "paper" and geometry == "areas":
        raise click.UsageError("--geometry: areas is refused under --profile paper; allowed: box")
    return geometry or ("box" if profile == "paper" else "areas")


def _address(text: str | None) -> address.Address | None:
    try:
        return address.parse(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None


def _candidates(asked: int | None, configured: int) -> int:
    if asked is not None and asked > configured:
        raise click.UsageError(
            f"--candidates: allowed: 1 to {configured}, the number of weight vectors (auction.weights)"
        )
    return asked or configured


def _runner() -> asyncio.Runner:
    return asyncio.Runner(loop_factory=uvloop.new_event_loop)


def run_until_signal(work: Coroutine[Any, Any, None]) -> None:
    """Runs `work` to its end, or cancels it on SIGINT or SIGTERM and lets it clean up."""
    with _runner() as runner:
        runner.run(_cancelled_by_signal(work))


async def _cancelled_by_signal(work: Coroutine[Any, Any, None]) -> None:
    loop = asyncio.get_running_loop()
    task = loop.create_task(work)
    for signum in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signum, task.cancel)
    await asyncio.wait([task])
    if not task.cancelled():
        task.result()
