"""One run of the command: open road and bus, agree with the manager, drive, report."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Protocol

import click
from msgspec import structs
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from gameopt_vehicles.bus import Bus, NoManager, configuration
from gameopt_vehicles.fleet import Fleet, Settings
from gameopt_vehicles.fleet import Progress as FleetProgress
from gameopt_vehicles.options import Options, reports
from gameopt_vehicles.report import Run, assemble, summary
from gameopt_vehicles.road import Road
from gameopt_vehicles.synthetic import SyntheticRoad
from gameopt_vehicles.together import Together
from gameopt_wire.intersection import Charter, IntersectionMap

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
EXIT_COLLISION = 4


class MeasuredRoad(Road, Protocol):
    """A road that can say how it went, and for which demand it was made (`ratio`: W and E over N and S)."""

    @property
    def flow_veh_h(self) -> float | None: ...
    @property
    def ratio(self) -> float | None: ...
    def measurements(self, warmup_s: float) -> object:
        """What happened after the warm-up, in the shape of `report.Measurements`."""
        ...


async def drive(options: Options, load: Callable[[], list[MeasuredRoad]] | None) -> int:
    """Run what `load` opens, one road for each junction, or a synthetic one without it; the exit code.

    Raises `NoManager`, `BadBusConfiguration`, and what `load` and its roads raise.
    """
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, stopped.set)
    endpoints = options.connect or (() if options.zenoh_config else (DEFAULT_ENDPOINT,))
    config = configuration(endpoints, options.zenoh_config)
    roads: list[MeasuredRoad] = load() if load else []
    names: list[str | None] = [road.map.intersection for road in roads]
    try:
        async with AsyncExitStack() as buses:
            runs: list[tuple[MeasuredRoad, Bus, Charter]] = []
            for name in names or options.junction or [None]:
                bus = await buses.enter_async_context(await Bus.open(config, reliable=options.clock == "lockstep"))
                charter = await bus.charter(name)
                if load is None:
                    roads.append(SyntheticRoad(charter.map, options.synthetic or 0, options.seed))
                _agree(charter, roads[len(runs)], options)
                bus.join(charter.map.intersection)
                runs.append((roads[len(runs)], bus, charter))
            return await _run(runs, options, stopped)
    finally:
        for road in roads:
            road.close()


def _agree(charter: Charter, road: MeasuredRoad, options: Options) -> None:
    """Manager and vehicles must speak of the same time and the same ground; raises `NoManager`."""
    if charter.clock != options.clock:
        raise NoManager(f"the manager runs on --clock {charter.clock}, the vehicles on --clock {options.clock}")
    if charter.turn_speed == options.ignore_turn_speed:
        kept, own = ("keeps", "ignore") if charter.turn_speed else ("ignores", "keep")
        raise NoManager(f"the manager {kept} turning speeds and the vehicles {own} them (--ignore-turn-speed)")
    # A map read without turning speeds is the same ground: those that are ignored do not have to agree.
    theirs = charter.digest if charter.turn_speed else _without_turn_speeds(charter.map).digest()
    ours = (road.map if charter.turn_speed else _without_turn_speeds(road.map)).digest()
    if theirs != ours:
        name = charter.map.intersection
        longest_m = [max(body.length_m for body in each.footprints) for each in (charter.map, road.map)]
        why = "" if longest_m[0] == longest_m[1] else ": for bodies up to {:g} m and {:g} m (--articulated)"
        why = why.format(*longest_m)
        raise NoManager(f"the manager's map of {name!r} ({theirs}) is not the vehicles' ({ours}){why}")


def _without_turn_speeds(intersection: IntersectionMap) -> IntersectionMap:
    movements = [structs.replace(movement, turn_speed_mps=None) for movement in intersection.movements]
    return structs.replace(intersection, movements=movements)


async def _run(runs: Sequence[tuple[MeasuredRoad, Bus, Charter]], options: Options, stopped: asyncio.Event) -> int:
    """One fleet for each road, bus and charter, step by step together; the worst of their exit codes."""
    settings = Settings(
        clock=options.clock,
        duration_s=options.duration,
        warmup_s=options.warmup,
        seed=options.seed,
        strategy=options.strategy,
        aggressiveness=options.aggressiveness,
        turn_speed=not options.ignore_turn_speed,
        tracking_noise_mps=options.tracking_noise,
        loss=options.loss,
        delay_s=options.delay_ms / 1000.0,
        jitter_s=options.jitter_ms / 1000.0,
    )
    start_s = runs[0][0].time_s
    together = Together(len(runs))
    with _progress_bar(options.duration, start_s, [charter.map.intersection for _, _, charter in runs]) as show:
        fleets = [
            Fleet(road, bus, settings, together=together, on_step=each)
            for (road, bus, _), each in zip(runs, show, strict=True)
        ]
        stopping = asyncio.create_task(_stop_when(stopped, fleets))
        try:
            ended = await asyncio.gather(*(_lead(fleet, stopped) for fleet in fleets), return_exceptions=True)
        finally:
            stopping.cancel()
    errors = [error for error in ended if error is not None]
    for error in errors:
        if not isinstance(error, NoManager):
            raise error
    codes = [
        _report(road, charter, fleet, options, start_s, path)
        for (road, _, charter), fleet, path in zip(runs, fleets, reports(options), strict=True)
    ]
    if errors:
        raise errors[0]  # a manager is gone: said once what was driven until then is written down
    return max(codes)


async def _lead(fleet: Fleet, stopped: asyncio.Event) -> None:
    """Run a fleet; what makes it fail ends the others after their step. All come to the end of the run together."""
    try:
        await fleet.run()
    except Exception:
        stopped.set()
        raise


def _report(
    road: MeasuredRoad, charter: Charter, fleet: Fleet, options: Options, start_s: float, path: Path | None
) -> int:
    """Say, and write down, how it went at one junction; the exit code."""
    setup = Run(
        scenario=options.sumo.stem if options.sumo else f"synthetic-{options.synthetic}",
        seed=options.seed,
        duration_s=round(road.time_s - start_s, 1),  # shorter than asked for when interrupted
        warmup_s=options.warmup,
        flow_veh_h=road.flow_veh_h,
        ratio=road.ratio,
    )
    report = assemble(setup, charter, road.measurements(options.warmup), fleet.tally, fleet.lost)
    Console().print(summary(report))
    if path is not None:
        try:
            path.write_bytes(report.to_json())
        except OSError as error:
            raise click.FileError(str(path), error.strerror) from None
    if report.collided():
        complain("vehicles collided; see the report")
        return EXIT_COLLISION
    return 0


async def _stop_when(stopped: asyncio.Event, fleets: Sequence[Fleet]) -> None:
    await stopped.wait()
    for fleet in fleets:
        fleet.stop()


@contextmanager
def _progress_bar(
    duration_s: float, start_s: float, names: Sequence[str]
) -> Iterator[list[Callable[[FleetProgress], None]]]:
    """A bar for each of several junctions on a terminal, nothing elsewhere: a log is no place for one."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}{task.fields[time_s]:6.1f} s"),
        BarColumn(),
        TextColumn("{task.fields[vehicles]:3d} vehicles  control cycle {task.fields[cycle_ms]:5.1f} ms"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        labels = [f"{name} " for name in names] if len(names) > 1 else [""]
        tasks = [bar.add_task(label, total=duration_s, time_s=start_s, vehicles=0, cycle_ms=0.0) for label in labels]

        def show(task: TaskID, now: FleetProgress) -> None:
            bar.update(
                task,
                completed=now.time_s - start_s,
                time_s=now.time_s,
                vehicles=now.vehicles,
                cycle_ms=now.control_cycle_ms,
            )

        yield [partial(show, task) for task in tasks]


def complain(message: str) -> None:
    """One line on stderr."""
    click.echo(f"gameopt-vehicles: {' '.join(message.split())}", err=True)
