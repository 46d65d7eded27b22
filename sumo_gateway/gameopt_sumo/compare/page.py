"""`report.md`: what was run, tables with the queue upstream beside every time, and the paper's claims."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

from gameopt_sumo.compare import claims, verdicts
from gameopt_sumo.compare.claims import Row
from gameopt_sumo.compare.computation import Computation, Joint
from gameopt_sumo.compare.plots import FOLDER
from gameopt_sumo.compare.preface import head
from gameopt_sumo.compare.reasons import LITERAL
from gameopt_sumo.compare.results import Entry, at, collided, figure, whole
from gameopt_sumo.compare.settings import Settings
from gameopt_sumo.compare.views import EVEN, View, ablations, views

OURS = ("coop", "coop@box", "coop-paper")
"""Measured against the paper's claims."""


class Made(NamedTuple):
    """How a page came to be."""

    commands: Sequence[str]
    """Every command that has added to the folder."""
    date: datetime
    plots: Sequence[str]
    at_bounds: Sequence[str] = ()
    """Tuned plans at a bound of their search."""


_COLUMNS = (
    ("throughput veh/min", "throughput_veh_min", 1),
    ("waiting upstream", "vehicles.waiting_to_enter", 0),
    ("in the zone", "vehicles.in_zone", 0),
    ("time-to-goal s", "time_to_goal_s.mean", 2),
    ("largest s", "time_to_goal_s.max", 1),
    ("emergency s", "by_class.emergency.time_to_goal_s", 2),
    ("fuel g", "fuel_g", 1),
    ("truck fuel g", "by_class.truck.fuel_g", 1),
    ("CO2 g", "co2_g", 0),
    ("fuel of all kg", "fuel_total_g", -3),
    ("CO2 of all kg", "co2_total_g", -3),
)
_PROBE_COLUMNS = (
    ("probes' time-to-goal s", "by_class.taxi.time_to_goal_s", 2),
    ("probes' fuel g", "by_class.taxi.fuel_g", 1),
)


def page(entries: Sequence[Entry], settings: Settings, computation: Computation | None, made: Made) -> str:
    """The whole page, Markdown."""
    parts = [head(entries, settings, made.commands, made.date), _failed(entries, computation), _collided(entries)]
    judged = [_claims(entries, ours, computation) for ours in OURS if whole(entries, method=ours)]
    parts += [_RULES, *judged] if any(judged) else []
    parts.append(_at_bounds(made.at_bounds))
    parts += [_view(view, made.plots) for view in views(entries)]
    parts += [_ablation(flow, group, made.plots) for flow, group in ablations(entries).items()]
    if computation is not None:
        parts.append(_computation(computation, made.plots))
    return "\n\n".join(part for part in parts if part) + "\n"


def _failed(entries: Sequence[Entry], computation: Computation | None) -> str:
    lines = [f"- `{e['run']}`: {e['failed']}" for e in entries if e["failed"] is not None]
    lines += [
        f"- computation, {name}: {reason}" for name, reason in (computation.failed if computation else {}).items()
    ]
    return "## Failed\n\nIn no mean below:\n\n" + "\n".join(lines) if lines else ""


def _collided(entries: Sequence[Entry]) -> str:
    """Every run with a collision, whoever's it is: it stays in the means, so the reader has to know."""
    lines = []
    for entry in collided(entries):
        counts = (
            at(entry, f"safety.{name}") or 0.0 for name in ("collisions_sumo", "collisions_geometric", "teleports")
        )
        lines.append("- `{}`: {:.0f} by SUMO, {:.0f} by geometry; {:.0f} teleports".format(entry["run"], *counts))
    return "## Runs with collisions\n\nThey are in the means below:\n\n" + "\n".join(lines) if lines else ""


def _claims(entries: Sequence[Entry], ours: str, computation: Computation | None) -> str:
    even = whole(entries, knob=None, ratio=EVEN, method=ours)
    flows = {e["flow_veh_h"] for e in even if e["flow_veh_h"]}
    if not flows:
        return ""
    uneven = {e["flow_veh_h"] for e in whole(entries, knob=None, ratio=4.0)}
    tables = {
        f"At {flow:,.0f} veh/h" + (", the highest demand measured" if flow == max(flows) else ""): claims.over_others(
            entries, ours, flow
        )
        for flow in dict.fromkeys((claims.PAPER_FLOW_VEH_H, max(flows)))
    }
    for flow in sorted(uneven) or [claims.UNBALANCED_FLOW_VEH_H]:
        tables[f"Unbalanced inflow at {flow:,.0f} veh/h"] = claims.unbalanced(entries, ours, flow)
    tables["Computation"] = claims.decisions(entries, ours, computation)
    shown = [_claim_table(title, rows) for title, rows in tables.items()]
    if ours == "coop-paper" and any(row.reason for rows in tables.values() for row in rows):
        shown.append(LITERAL)
    about = [f"## The paper's claims, and `{ours}`"] + ([_OTHER_GEOMETRY] if ours == "coop" else [])
    return "\n\n".join((*about, *shown))


_RULES = f"""## How claims are judged

Changes are taken seed by seed. Against another method, a claim of *at least* is reproduced by the \
claimed change or more; a claim of *around* also where what is left, ours over theirs, is within \
{verdicts.NEAR:.0%} of what the claim leaves. *Unperturbed* is a change of at most {verdicts.FLAT:.0%}; what a method \
itself loses or gains is reproduced within {verdicts.CLOSE:.0%} of it. *Not decided*: the 95 % interval contains the \
threshold; from a single seed, without an interval, the mean alone decides. Ratio: what is left over what the claim \
leaves (1.10 of a time: a tenth more than claimed). Waiting: vehicles upstream at the end, ours / theirs \
(1:1 / 4:1). The labels are those of the paper's LaTeX source."""
_OTHER_GEOMETRY = (
    "Our `stop-sign` reserves the whole box, as stop signs do; `coop` takes conflict areas. What the areas alone bring "
    "shows beside `coop@box`."
)


def _claim_table(title: str, rows: Sequence[Row]) -> str:
    """The claims there are data for; below them why some were not reproduced, and which there are no data for."""
    lines = [
        f"| {r.words} (`{r.label}`) | {r.claimed} | {r.measured} | {r.ratio} | {r.seeds} | {r.waiting} | {r.verdict} |"
        for r in rows
        if r.verdict != verdicts.NO_DATA
    ]
    head = [
        "| claim | paper | measured | ratio | seeds | waiting | verdict |",
        "| --- | ---: | ---: | ---: | ---: | ---: | --- |",
    ]
    parts = [f"### {title}"]
    if lines:
        parts.append("\n".join((*head, *lines)))
    if why := claims.missed(rows):
        listed = [f"- {'; '.join(words)}: {reason}." for reason, words in why.items()]
        parts.append("Not reproduced, and why:\n\n" + "\n".join(listed))
    if lacking := "; ".join(f"{row.words}, {row.claimed}" for row in rows if row.verdict == verdicts.NO_DATA):
        parts.append(f"No data for: {lacking}.")
    return "\n\n".join(parts)


def _view(view: View, plots: Sequence[str]) -> str:
    columns = (*_PROBE_COLUMNS, *_COLUMNS) if view.name.startswith("aggressiveness") else _COLUMNS
    lines = [
        _line(f"{x:g}" if x else "0" if view.axis != "demand, veh/h" else "-", method, view.series[method][x], columns)
        for x in sorted({x for series in view.series.values() for x in series})
        for method in view.series
        if x in view.series[method]
    ]
    shown = "\n".join(
        f"- [{metric.title}]({FOLDER}/{name}.png){_paper(view, metric)}"
        for metric in view.metrics
        if (name := f"{view.name}-{metric.name}") in plots
    )
    return f"## {view.title}\n\n{_header(view.axis, columns)}\n" + "\n".join(lines) + f"\n\n{shown}"


def _paper(view: View, metric: object) -> str:
    kind = {"flows": "over_flow", "unbalanced": "over_ratio"}.get(view.name.partition("-")[0], "")
    label = getattr(metric, kind, None) if kind else None
    return f", the paper's `{label}`" if label else ""


def _header(axis: str, columns: Sequence[tuple[str, str, int]]) -> str:
    names = [axis, "method", "seeds", "arrived", *(name for name, _, _ in columns)]
    names += ["collisions SUMO / geometric", "hard brakes", "decision ms p50 / p99"]
    return f"| {' | '.join(names)} |\n| ---: | --- |" + " ---: |" * (len(names) - 2)


def _line(x: str, method: str, runs: Sequence[Entry], columns: Sequence[tuple[str, str, int]]) -> str:
    cells = [x, method, str(len(runs)), _cell(runs, "vehicles.arrived", 0)]
    cells += [_cell(runs, path, digits) for _, path, digits in columns]
    counts = (sum(at(e, f"safety.collisions_{by}") or 0.0 for e in runs) for by in ("sumo", "geometric"))
    cells += [" / ".join(f"{count:.0f}" for count in counts), _cell(runs, "safety.hard_brakes", 1)]
    p50, p99 = (figure(runs, f"control_cycle.{name}") for name in ("p50_ms", "p99_ms"))
    cells.append(f"{p50.mean:.1f} / {p99.mean:.1f}" if p50 and p99 else "-")
    return f"| {' | '.join(cells)} |"


def _cell(runs: Sequence[Entry], path: str, digits: int) -> str:
    """Mean and half interval; negative digits are thousands, in kg for g."""
    found = figure(runs, path)
    if found is None:
        return "-"
    scale, digits = (1000.0, 2) if digits < 0 else (1.0, digits)
    half = "" if found.half is None else f" ± {found.half / scale:.{digits}f}"
    seeds = "" if found.seeds == len(runs) else f" ({found.seeds_of(len(runs))})"
    return f"{found.mean / scale:.{digits}f}{half}{seeds}"


def _ablation(flow: float, group: dict[str, list[Entry]], plots: Sequence[str]) -> str:
    lines = [_line(f"{flow:g}", name, runs, _COLUMNS) for name, runs in group.items() if runs]
    name = f"ablation-{flow:g}"
    shown = f"\n\n- [throughput and time-to-goal]({FOLDER}/{name}.png)" if name in plots else ""
    title = f"## Ideas switched off one by one, at {flow:,.0f} veh/h"
    both = f"\n\n{_NOT_ALONE}" if any(name.startswith(_UPSTREAM_OFF) for name in group) else ""
    return f"{title}{both}\n\n{_header('demand, veh/h', _COLUMNS)}\n" + "\n".join(lines) + shown


_UPSTREAM_OFF = "ablation-waiting-upstream"
_NOT_ALONE = (
    f"`{_UPSTREAM_OFF}` switches the programs off as well, which spread the waiting: what waiting upstream brings is "
    "its difference from `ablation-programs`, not from `coop`."
)


def _computation(computation: Computation, plots: Sequence[str]) -> str:
    parts = ["## Computation"]
    if computation.decisions:
        lines = [f"| {d.vehicles:g} | {d.p50_ms:.2f} | {d.p99_ms:.2f} |" for d in computation.decisions]
        head = "| vehicles | median ms | 99th percentile ms |\n| ---: | ---: | ---: |"
        parts.append(f"Decision, snapshot in and commands out, on made-up traffic:\n\n{head}\n" + "\n".join(lines))
    if growths := computation.growths:
        fits = (f"{g.constant_ms:.2f} ms + {1e3 * g.slope_ms:.3g} us {g.term} (R^2 {g.r_squared:.4f})" for g in growths)
        parts.append(f"Least-squares fits of the median: {'; '.join(fits)}.")
    if computation.joint:
        parts.append(_joint(computation.joint))
    if computation.ended is not None:
        parts.append(f"More vehicles were not tried: {computation.ended}.")
    if (machine := computation.machine) is not None:
        parts.append(f"Measured on {machine.processor}, {machine.cores} cores.")
    if "computation" in plots:
        parts.append(f"- [decision time against vehicles]({FOLDER}/computation.png)")
    return "\n\n".join(parts)


def _joint(sizes: Sequence[Joint]) -> str:
    lines = [
        f"| {j.vehicles} | {j.states} | {j.proven:.0%} | {j.joint_ms:.1f} | {j.auction_ms:.2f} | {j.full_rows_ms:.2f} "
        f"| {j.factor:,.0f} | {'-' if j.excess is None else f'{j.excess:+.1%}'} |"
        for j in sizes
    ]
    names = ["vehicles", "states", "proven optimal", "joint MIQP ms", "auction and QPs ms", "on full rows ms"]
    names += ["times faster", "objective above the optimum"]
    head = f"| {' | '.join(names)} |\n|{' ---: |' * len(names)}"
    return (
        "The joint program of order and speeds (SCIP) against the paper's auction and its QPs, with reduced and with "
        f"full lateral rows, on the same recorded states; medians:\n\n{head}\n" + "\n".join(lines)
    )


def _at_bounds(lines: Sequence[str]) -> str:
    if not lines:
        return ""
    listed = "\n".join(f"- {line}" for line in lines)
    return f"## Lights at a bound of the search\n\nBetter plans may lie beyond:\n\n{listed}"
