"""The command line of `gameopt-vehicles`, parsed and checked."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import msgspec

from gameopt_vehicles.strategies import Strategy, strategy_named
from gameopt_wire import keys
from gameopt_wire.messages import Clock


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """The command line, parsed."""

    sumo: Path | None
    synthetic: int | None
    junction: tuple[str, ...]
    connect: tuple[str, ...]
    zenoh_config: Path | None
    clock: Clock
    duration: float
    warmup: float
    seed: int
    report: Path | None
    loss: float
    delay_ms: float
    jitter_ms: float
    ignore_turn_speed: bool
    articulated: bool
    inflate: float
    tracking_noise: float
    strategy: Strategy
    aggressiveness: dict[str, float]
    gui: bool
    sumo_options: tuple[str, ...]


class Number(click.FloatRange):
    """A range that NaN and infinity are outside of."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number, or one line that says what is allowed."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def parse_strategy(_context: click.Context, _option: click.Parameter, name: str) -> Strategy:
    """The strategy behind a name; a bad one is the user's error."""
    try:
        return strategy_named(name)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None


def parse_aggressiveness(_context: click.Context, _option: click.Parameter, text: str | None) -> dict[str, float]:
    """`taxi=0.5,truck=1` as {"taxi": 0.5, "truck": 1.0}; anything else is the user's error."""
    chosen: dict[str, float] = {}
    for part in text.split(",") if text else ():
        name, _, number = part.partition("=")
        try:
            chosen[name.strip()] = float(number)
        except ValueError:
            chosen[name.strip()] = math.nan
        if not (name.strip() and 0.0 <= chosen[name.strip()] <= 1.0):
            raise click.BadParameter(f"{part!r}; allowed: CLASS=D with D from 0 to 1, separated by commas")
    return chosen


def check(options: Options) -> None:
    """What click cannot see by looking at one option alone."""
    if (options.sumo is None) == (options.synthetic is None):
        raise click.UsageError("give exactly one of --sumo FILE.sumocfg and --synthetic N")
    if options.warmup >= options.duration:
        raise click.UsageError(f"--warmup {options.warmup:g} s must be less than --duration {options.duration:g} s")
    if options.sumo is None and (options.gui or options.articulated or options.sumo_options):
        raise click.UsageError("--gui, --articulated and SUMO options need --sumo")
    if len(set(options.junction)) < len(options.junction):
        raise click.UsageError(f"--junction {', '.join(options.junction)}: name each once")
    if options.sumo is None and len(options.junction) > 1:
        raise click.UsageError("several --junction need --sumo")
    for report in reports(options):
        if report is not None:
            _check_writable(report)


def reports(options: Options) -> list[Path | None]:
    """Where the report of each junction goes: of several, to files with the junction's id before the suffix."""
    path = options.report
    if path is None or len(options.junction) < 2:
        return [path] * max(1, len(options.junction))
    return [path.with_suffix(f".{keys.encode(junction)}{path.suffix}") for junction in options.junction]


def _check_writable(report: Path) -> None:
    """A report that cannot be written is refused before the run, not after it; the file stays as it is."""
    if not report.parent.is_dir():
        raise click.UsageError(f"--report {report}: no such directory {report.parent}")
    try:
        existed = report.exists()
        report.open("ab").close()
        if not existed:
            report.unlink()
    except OSError as error:
        raise click.UsageError(f"--report {report}: {error.strerror}") from None
