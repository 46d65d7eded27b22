"""What `gameopt_im.optimal` finds: its file, which it goes on from, and its table."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
from rich.table import Table

from gameopt_im.options import StartError

SCHEMA = "gameopt-optimal/2"
COLUMNS = (
    "vehicles", "pairs", "solved", "optimum, ms p50 / max", "auction + QPs, ms", "on full rows, ms", "times faster",
    "objective over optimum",
)  # fmt: skip


class Compared(msgspec.Struct, frozen=True):
    """One state of n vehicles. Times in s; objectives on full lateral rows, None where none was found.

    `orders_open` is how many pairs' order is free, `solved` whether the optimum was proven within the limit, `bound`
    what no order can go below. `auction_s` is bids, sequences and their K programs on reduced lateral rows, as the
    profile `paper` has them; `full_rows_s` the same on full rows.
    """

    time_s: float
    orders_open: int
    solved: bool
    optimal_s: float
    optimal: float | None
    bound: float
    auction_s: float
    auction: float
    full_rows_s: float
    full_rows: float


class Size(msgspec.Struct, frozen=True):
    """All states of one number of vehicles."""

    vehicles: int
    states: list[Compared]


class Results(msgspec.Struct, frozen=True):
    """What `--json` writes."""

    schema: str
    versions: dict[str, str]
    recording: str
    digest: str
    """SHA-256 of the recording."""
    candidates: int
    states: int
    """States wanted of each size."""
    limit_s: float
    sizes: list[Size]
    ended: str | None = None
    """Why larger sizes were not looked at; None while there are sizes to come."""


def kept(file: Path | None, wanted: Results) -> list[Size]:
    """The sizes that are there, each whole. Raises `StartError` for results of anything else than is wanted."""
    if file is None or not file.exists():
        return []
    try:
        there = msgspec.json.decode(file.read_bytes(), type=Results)
    except OSError as error:
        raise StartError(f"{file}: {error.strerror or error}") from None
    except msgspec.DecodeError as error:
        raise StartError(f"{file}: not results that can be gone on from: {error}; choose another --json") from None
    for name in ("schema", "versions", "digest", "candidates", "states", "limit_s"):
        if (before := getattr(there, name)) != (now := getattr(wanted, name)):
            raise StartError(f"{file}: holds results with {name} {before}, not {now}; choose another --json")
    return there.sizes


def write(path: Path, results: Results) -> None:
    """Keep them, whole or not at all: they are gone on from. Raises `StartError`."""
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_bytes(msgspec.json.format(msgspec.json.encode(results)))
        partial.replace(path)
    except OSError as error:
        raise StartError(f"{path}: {error.strerror or error}") from None


def table(results: Results) -> Table:
    """The results to read, a line a size."""
    shown = Table(title=f"{results.recording}: joint order and speeds against {results.candidates} sequences")
    for column in COLUMNS:
        shown.add_column(column, justify="right")
    for size in results.sizes:
        states = size.states
        solved = [each for each in states if each.solved]
        optimum, auction, full = (
            1e3 * np.array([getattr(each, name) for each in states])
            for name in ("optimal_s", "auction_s", "full_rows_s")
        )
        over = [each.auction / each.optimal for each in solved if each.optimal]
        shown.add_row(
            str(size.vehicles),
            f"{np.median([each.orders_open for each in states]):.0f}",
            f"{len(solved)} of {len(states)}",
            f"{np.median(optimum):.0f} / {optimum.max():.0f}",
            f"{np.median(auction):.1f} / {auction.max():.1f}",
            f"{np.median(full):.1f} / {full.max():.1f}",
            f"{np.median(optimum / auction):.0f}",
            f"{np.median(over):.3f} / {max(over):.3f}" if over else "-",
        )
    return shown
