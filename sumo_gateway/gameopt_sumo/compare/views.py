"""What can be read off a results folder: each experiment as series of runs over what was varied."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gameopt_sumo.compare.methods import known
from gameopt_sumo.compare.results import Entry, whole

EVEN = 1.0
"""The ratio of balanced inflow."""
ABLATION = "ablation-"


class Metric(NamedTuple):
    """A figure of the report, and the paper's figure that shows it (over flow, over the inflow's ratio)."""

    name: str
    path: str
    title: str
    over_flow: str | None = None
    over_ratio: str | None = None


METRICS = (
    Metric(
        "throughput", "throughput_veh_min", "throughput, veh/min", "fig: Throughput_go v2", "fig: Throughput_go_un v2"
    ),
    Metric("time-to-goal", "time_to_goal_s.mean", "mean time-to-goal, s", "fig: TTG_go v2", "fig: TTG_go_un v2"),
    Metric("time-to-goal-max", "time_to_goal_s.max", "largest time-to-goal, s"),
    Metric("fuel", "fuel_g", "fuel per vehicle, g", "fig: fuel_go v2", "fig: fuel_go_un v2"),
    Metric("fuel-total", "fuel_total_g", "fuel of all that crossed, g"),
    Metric("co2", "co2_g", "CO2 per vehicle, g", "fig: CO2_go v2", "fig: CO2_go_un v2"),
    Metric("co2-total", "co2_total_g", "CO2 of all that crossed, g"),
    Metric(
        "emergency-time",
        "by_class.emergency.time_to_goal_s",
        "mean time-to-goal of emergency vehicles, s",
        "fig: EV_TTG_go v2",
        "fig: EV_TTG_go_un v2",
    ),
    Metric(
        "truck-fuel",
        "by_class.truck.fuel_g",
        "fuel per truck, g",
        "fig: truck_fuel_go v2",
        "fig: truck_fuel_go_un v2",
    ),
    Metric("waiting", "vehicles.waiting_to_enter", "vehicles waiting upstream at the end"),
)
_OWN = (
    Metric("own-time", "by_class.taxi.time_to_goal_s", "mean time-to-goal of the probes, s"),
    Metric("own-fuel", "by_class.taxi.fuel_g", "fuel per probe, g"),
)


@dataclass(frozen=True)
class View:
    """One experiment: by method, the runs at each value of what was varied."""

    name: str
    title: str
    axis: str
    metrics: tuple[Metric, ...]
    series: dict[str, dict[float, list[Entry]]]


_KNOBS = {
    "aggressiveness": ("aggressiveness d of the probes, a tenth of all vehicles", (*_OWN, *METRICS)),
    "lambda": ("trade-off lambda", METRICS),
    "trucks": ("share of trucks", METRICS),
    "noise": ("error of the speed driven in each 0.1 s, sigma, m/s", METRICS),
}


def views(entries: Sequence[Entry]) -> list[View]:
    """The experiments there are runs of, without ablations: those are no series."""
    plain = [e for e in whole(entries, knob=None) if not e["method"].startswith(ABLATION)]
    found = []
    even = [e for e in plain if e["ratio"] in (None, EVEN)]
    if even:
        found.append(View("flows", "Over demand", "demand, veh/h", METRICS, _series(even, "flow_veh_h")))
    for flow in sorted({e["flow_veh_h"] for e in plain if e["ratio"] not in (None, EVEN)}):
        at_flow = [e for e in plain if e["flow_veh_h"] == flow]
        title = f"Unbalanced inflow at {flow:,.0f} veh/h"
        axis = "flow of west and east over that of north and south"
        found.append(View(f"unbalanced-{flow:g}", title, axis, METRICS, _series(at_flow, "ratio")))
    for knob, (axis, metrics) in _KNOBS.items():
        turned = whole(entries, knob=knob)
        for flow in sorted({e["flow_veh_h"] for e in turned}):
            at_flow = [e for e in turned if e["flow_veh_h"] == flow]
            title = f"{knob.capitalize()} at {flow:,.0f} veh/h"
            found.append(View(f"{knob}-{flow:g}", title, axis, metrics, _series(at_flow, "value")))
    return found


def ablations(entries: Sequence[Entry]) -> dict[float, dict[str, list[Entry]]]:
    """By flow, the runs of each ablation and of the method it is taken from, on the geometries measured."""
    plain = whole(entries, knob=None, ratio=EVEN)
    found: dict[float, dict[str, list[Entry]]] = {}
    for flow in sorted({e["flow_veh_h"] for e in plain if e["method"].startswith(ABLATION)}):
        at_flow = [e for e in plain if e["flow_veh_h"] == flow]
        names = {e["method"] for e in at_flow if e["method"].startswith(ABLATION)}
        full = {"coop" + ("@" + geometry if at else "") for _, at, geometry in (n.partition("@") for n in names)}
        order = [*sorted(full), *sorted(names, key=lambda name: (name.partition("@")[2], name))]
        found[flow] = {name: [e for e in at_flow if e["method"] == name] for name in order}
    return found


def in_order(methods: Iterable[str]) -> list[str]:
    """Methods as `known` lists them."""
    order = list(known())
    return sorted(methods, key=lambda name: (_place(order, name.partition("@")[0]), name))


def _place(order: list[str], name: str) -> int:
    return order.index(name) if name in order else len(order)


def _series(entries: Sequence[Entry], over: str) -> dict[str, dict[float, list[Entry]]]:
    series: dict[str, dict[float, list[Entry]]] = {}
    for name in in_order({e["method"] for e in entries}):
        mine = [e for e in entries if e["method"] == name]
        values = sorted({0.0 if e[over] is None else e[over] for e in mine})
        series[name] = {x: [e for e in mine if (0.0 if e[over] is None else e[over]) == x] for x in values}
    return series
