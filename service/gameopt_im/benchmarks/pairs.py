"""Two ways to do the same, timed in turn on the same states: the ratio of their times is the result.

What else the machine does comes and goes within minutes, and falls on both ways of a pair alike. So the median of the
paired ratios is told, with a distribution-free 95 % interval, and the time of the second way as a note. A pair of
which an answer is wrong counts as `off` and not for the ratio; with more than `MOST_OFF` of them there is none.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import cycle, islice
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from rich.table import Table
from scipy import stats

from gameopt_im.core.snapshot import Floats

State = TypeVar("State")
Answer = TypeVar("Answer")

LEVEL = 0.95
MOST_OFF = 0.1


class Ratio(msgspec.Struct, frozen=True):
    """Time of the first way over that of the second, and the second's median in ms.

    `low` and `high` are None where pairs are too few for an interval (under 6); all figures are where `failed` says
    why there is no ratio.
    """

    traffic: str
    compares: str
    pairs: int
    off: int = 0
    median: float | None = None
    low: float | None = None
    high: float | None = None
    second_ms: float | None = None
    failed: str | None = None
    note: str = ""


class Timed(NamedTuple):
    """What a way took on a state, s, and what was wrong with its answer; None for nothing."""

    seconds: float
    wrong: str | None


def timed(
    do: Callable[[], Answer], wrong: Callable[[Answer], str | None], clock: Callable[[], float] = time.process_time
) -> Timed:
    """Run it, then look at its answer off the clock: processor time, in which what else runs counts little."""
    started = clock()
    answer = do()
    seconds = clock() - started
    return Timed(seconds, wrong(answer))


def in_turn(states: Sequence[State], ways: dict[str, Callable[[State], Timed]]) -> dict[str, list[Timed]]:
    """Every way on every state; who goes first changes from state to state."""
    results: dict[str, list[Timed]] = {name: [] for name in ways}
    for number, state in enumerate(states):
        for name in rotated(list(ways), number):
            results[name].append(ways[name](state))
    return results


def rotated(names: Sequence[str], by: int) -> list[str]:
    """The names, the first of them another one each time."""
    start = by % len(names)
    return list(islice(cycle(names), start, start + len(names)))


def ratio(traffic: str, compares: str, first: Sequence[Timed], second: Sequence[Timed], note: str = "") -> Ratio:
    """Median of the paired ratios first / second."""
    pairs = list(zip(first, second, strict=True))
    wrong = [why for pair in pairs if (why := next((each.wrong for each in pair if each.wrong), None))]
    off = len(wrong)
    if not pairs or off > MOST_OFF * len(pairs):
        why = f"{off} of {len(pairs)} off: {wrong[0]}" if wrong else "no states"
        return Ratio(traffic, compares, len(pairs), off, failed=why, note=note)
    good = [pair for pair in pairs if not any(each.wrong for each in pair)]
    a, b = np.array([[each.seconds for each in pair] for pair in good]).T
    low, high = interval(a / b)
    return Ratio(
        traffic, compares, len(good), off, float(np.median(a / b)), low, high, 1e3 * float(np.median(b)), note=note
    )  # fmt: skip


def interval(values: Floats) -> tuple[float | None, float | None]:
    """The interval of the median at `LEVEL` or above, by order statistics; None where there are too few."""
    found: Any = stats.quantile_test(values, q=float(np.median(values)), p=0.5).confidence_interval(LEVEL)
    return (None, None) if np.isnan(found.low + found.high) else (float(found.low), float(found.high))


def table(ratios: Sequence[Ratio]) -> Table:
    """The ratios to read, a line each."""
    shown = Table(title="ratios of times, measured in turn: median (95 %)")
    for name in ("traffic", "first / second", "ratio", "pairs", "second, ms"):
        shown.add_column(name, justify="left" if name in ("traffic", "first / second") else "right")
    before = None
    for each in ratios:
        if before not in (None, each.traffic):
            shown.add_section()
        title = "" if each.traffic == before else each.traffic
        before = each.traffic
        compares = f"{each.compares} ({said})" if (said := each.failed or each.note) else each.compares
        if each.median is None:
            shown.add_row(title, compares, "-", str(each.pairs), "-")
            continue
        spread = "" if each.low is None else f" ({each.low:.2f} to {each.high:.2f})"
        pairs = f"{each.pairs} (+{each.off} off)" if each.off else str(each.pairs)
        shown.add_row(title, compares, f"{each.median:.2f}{spread}", pairs, f"{each.second_ms:.2f}")
    return shown
