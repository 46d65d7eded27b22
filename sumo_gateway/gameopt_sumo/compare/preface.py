"""The beginning of `report.md`: what was run, with what, and what a reader has to know of it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from gameopt_sumo.baselines.plan import Kind
from gameopt_sumo.baselines.search import feasible, starts
from gameopt_sumo.compare.methods import known, named
from gameopt_sumo.compare.results import Entry
from gameopt_sumo.compare.settings import DEVELOPED_ON, FILE, Settings
from gameopt_sumo.compare.views import in_order
from gameopt_sumo.scenarios import FourArm


def head(entries: Sequence[Entry], settings: Settings, ran: Sequence[str], date: datetime) -> str:
    """Commands, versions, settings, seeds, how to read the figures, and the methods."""
    names = in_order({entry["method"] for entry in entries})
    about = "\n".join(f"- `{name}`: {_about(name)}" for name in names)
    versions = ", ".join(f"{name} {version}" for name, version in settings.versions.items())
    turning = "respected" if settings.turn_speed else "ignored by our methods, respected by SUMO's own drivers"
    net = "" if settings.sumo is None else f" Net and arrivals: {settings.sumo}."
    commands = "\n".join(ran)
    return f"""# Comparison

```
{commands}
```

{date:%Y-%m-%d}; {versions}

{settings.duration_s:g} s simulated, the first {settings.warmup_s:g} s not measured. Geometry {settings.geometry} \
unless a method fixes its own; turning speeds {turning}.{net} {_tuned(entries, settings)}All settings: `{FILE}`; every \
run: `results.json`, `results.csv`.

{_seeds(entries, settings)}

Figures are means over the seeds, ± half of the 95 % interval (Student's t; none from a single seed); \
`(2 of 3)` stands where not every seed has the figure. \
Time-to-goal begins at the control zone: what a vehicle waits upstream of it is not in it, so read every time beside \
the vehicles left waiting upstream at the end. Means are over vehicles that crossed in the measuring window: those \
still in the zone at its end, the slowest among them, are left out, and the more so the shorter the window.

{about}"""


def _about(name: str) -> str:
    base, at_, geometry = name.partition("@")
    return known()[base].about + (f", {geometry} geometry" if at_ else "")


def _tuned(entries: Sequence[Entry], settings: Settings) -> str:
    """How the lights on the page were tuned; nothing where there are none."""
    demands = _demands(entries)
    if not demands:
        return ""
    seeds = ", ".join(map(str, settings.tuning_seeds))
    kinds = dict.fromkeys(kind for kind, demand in demands if settings.tuning_budget <= _starts(kind, demand))
    without = f" Of {' and '.join(kinds)} lights these are Webster's plans only, no search." if kinds else ""
    return (
        f"Lights have the best of {settings.tuning_budget} plans tried for each demand on seeds {seeds}; all of them "
        f"are in `plans/`.{without} "
    )


def _demands(entries: Sequence[Entry]) -> list[tuple[Kind, FourArm]]:
    """What lights were tuned for."""
    kinds: tuple[Kind, ...] = ("fixed", "actuated")
    needed = {
        (entry["flow_veh_h"], 1.0 if method.plan == "even" else entry["ratio"], method.control)
        for entry in entries
        if (method := named(entry["method"])).plan is not None
    }
    return [
        (kind, FourArm(flow_veh_h=flow, ratio=ratio))
        for kind in kinds
        for flow, ratio, control in sorted(needed)
        if control == kind
    ]


def _starts(kind: Kind, demand: FourArm) -> int:
    """With how many plans of Webster's a search begins."""
    return sum(map(feasible, set(starts(demand, kind))))


def _seeds(entries: Sequence[Entry], settings: Settings) -> str:
    """Whether our defaults have seen the arrivals; the lights never have."""
    if settings.sumo is not None:
        return "The arrivals are the scenario's own; seeds are SUMO's."
    seeds = sorted({entry["seed"] for entry in entries})
    seen = [seed for seed in seeds if seed in DEVELOPED_ON]
    if not seen:
        return "The arrivals are held out: neither our defaults nor the lights were tuned on these seeds."
    return (
        f"Not held out: the defaults of `coop` were chosen on runs of seeds {DEVELOPED_ON[0]} to 110 among others "
        f"(docs/results/controller.md), {', '.join(map(str, seen))} of this page among them; lights have never seen "
        "the seeds they are measured on. `--first-seed 301` measures on arrivals that nobody has seen."
    )
