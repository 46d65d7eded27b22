"""How times grow with the number of vehicles: a free exponent, and n log n against n^2.

Fits are least squares of log t, so that an error counts relative to its time. `beyond` is what decides: the slope of
log(t / (n log n)) against log n. Where its whole interval is at 0 or below, t grows no faster than n log n.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from rich.table import Table
from scipy import stats

from gameopt_im.benchmarks.pairs import LEVEL
from gameopt_im.core.snapshot import Floats

FEWEST = 3
"""Numbers of vehicles that a fit needs: with two there is no interval."""
NO_FASTER, FASTER, OPEN = "no faster", "faster", "not decided"


class Interval(msgspec.Struct, frozen=True):
    """An estimate with its interval at `LEVEL`."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


class Growth(msgspec.Struct, frozen=True):
    """t = c n^`exponent` of one stage's medians; `beyond` n log n; factors c in ms of c n log n and c n^2.

    `by_uncleared` is the exponent against the vehicles without a clearance, of which a fixed junction has more than
    its share the fuller it is. `last` is the exponent between the two largest numbers of vehicles, where what costs the
    same for any number counts least. `spread_*` are standard deviations of log t around a fit (0.1 is ten per cent).
    `verdict` compares with n log n.
    """

    stage: str
    exponent: Interval
    beyond: Interval
    by_uncleared: Interval | None
    last: float
    n_log_n_ms: float
    spread_n_log_n: float
    n_squared_ms: float
    spread_n_squared: float
    verdict: str


def growth(stage: str, vehicles: Sequence[float], uncleared: Sequence[float], times_ms: Sequence[float]) -> Growth:
    """The fits. Raises ValueError for fewer than `FEWEST` numbers of vehicles, one below 2, or times not above 0."""
    n, t = np.array(vehicles, dtype=np.float64), np.array(times_ms, dtype=np.float64)
    if len(set(vehicles)) < FEWEST or n.min() < 2.0 or t.min() <= 0.0:
        raise ValueError(f"{stage}: needs {FEWEST} different numbers of vehicles, each 2 or more, and times above 0")
    without, sort = np.array(uncleared, dtype=np.float64), np.argsort(n)
    n, t, without = n[sort], t[sort], without[sort]
    n_log_n = n * np.log(n)
    beyond = _slope(n, t / n_log_n)
    return Growth(
        stage=stage,
        exponent=_slope(n, t),
        beyond=beyond,
        by_uncleared=_slope(without, t) if without.min() > 0.0 and len(set(uncleared)) >= FEWEST else None,
        last=float(np.log(t[-1] / t[-2]) / np.log(n[-1] / n[-2])),
        n_log_n_ms=_factor(n_log_n, t),
        spread_n_log_n=_spread(n_log_n, t),
        n_squared_ms=_factor(n**2, t),
        spread_n_squared=_spread(n**2, t),
        verdict=NO_FASTER if beyond.high <= 0.0 else FASTER if beyond.low > 0.0 else OPEN,
    )


def growths(
    vehicles: Sequence[float], uncleared: Sequence[float], medians_ms: Sequence[Mapping[str, float]]
) -> list[Growth]:
    """Every stage's, from its medians at these numbers of vehicles; none where there are fewer than `FEWEST`.

    A stage that did not run everywhere is left out.
    """
    if len(set(vehicles)) < FEWEST or min(vehicles) < 2.0:
        return []
    stages = [stage for stage in medians_ms[-1] if all(each.get(stage, 0.0) > 0.0 for each in medians_ms)]
    return [growth(stage, vehicles, uncleared, [each[stage] for each in medians_ms]) for stage in stages]


def table(fits: Sequence[Growth]) -> Table:
    """The fits to read, a line a stage."""
    shown = Table(title="growth with the vehicles present: t = c n^exponent (95 %)")
    for name in ("stage", "exponent", "beyond n log n", "off n log n, n^2", "than n log n"):
        shown.add_column(name, justify="left" if name == "stage" else "right")
    for each in fits:
        off = f"{100.0 * each.spread_n_log_n:.0f} %, {100.0 * each.spread_n_squared:.0f} %"
        shown.add_row(each.stage, str(each.exponent), str(each.beyond), off, each.verdict)
    return shown


def _slope(n: Floats, t: Floats) -> Interval:
    """The slope of log t against log n, with Student's interval."""
    fit = stats.linregress(np.log(n), np.log(t))
    half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, len(n) - 2) * fit.stderr)
    return Interval(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)


def _factor(term: Floats, t: Floats) -> float:
    """c of t = c term."""
    return float(np.exp(np.mean(np.log(t / term))))


def _spread(term: Floats, t: Floats) -> float:
    return float(np.std(np.log(t / term), ddof=1))
