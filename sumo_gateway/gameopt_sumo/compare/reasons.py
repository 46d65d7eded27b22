"""Why a claim was not reproduced, as far as the runs themselves show it; else that they do not."""

from __future__ import annotations

from collections.abc import Sequence

from gameopt_sumo.baselines.tuning import LEFT_BEHIND
from gameopt_sumo.compare.results import Entry, difference, figure

UPSTREAM = (
    "the other side has clearly more vehicles left upstream or in the zone, whose time and fuel are not counted: the "
    "more a method is overloaded, the better it looks in these figures, and the less is left to gain on it"
)
TOTALS = "totals are over all that crossed, and more vehicles crossed under ours"
MET = "the demand is met on both sides, so there is nothing to gain or lose"
STRONGER = (
    "the other side lets so many of the arriving vehicles cross that the claimed gain is more than is left: it is "
    "stronger than the paper's"
)
SHARED = (
    "taken in the runs, while others share the machine, and in lock-step, where a control cycle waits for all programs"
)
UNKNOWN = "the runs themselves do not show why"
LITERAL = (
    "Taken literally the paper's program is rarely feasible in a closed loop, so most of its rows have slack, and the "
    "interlock makes vehicles stop that the program would not (docs/algorithm.md)."
)


def over_another(path: str, claimed: float, ours: Sequence[Entry], theirs: Sequence[Entry], plan: str) -> str:
    """Why the figure at `path` is less better than claimed; `plan` is where the others' signal plan is, if any."""
    if path == "throughput_veh_min":
        if _met(ours) and _met(theirs):
            return MET
        if _mean(ours, path) > _mean(theirs, path) and _left_to_gain(ours, theirs) < claimed:
            return STRONGER + (f" (plan: `{plan}`)" if plan else "")
        return UNKNOWN
    if path.endswith("_total_g") and _mean(ours, "vehicles.crossed") > _mean(theirs, "vehicles.crossed"):
        return TOTALS
    return UPSTREAM if left_more(theirs, ours) else UNKNOWN


def over_itself(path: str, verdict: str, even: Sequence[Entry], uneven: Sequence[Entry]) -> str:
    """Why a method changes otherwise than claimed when its inflow does."""
    if path == "throughput_veh_min" and _met(even) and _met(uneven):
        return MET
    hidden = path != "throughput_veh_min" and not verdict.endswith(("larger", "it changes"))
    return UPSTREAM if hidden and left_more(uneven, even) else UNKNOWN


def left_more(entries: Sequence[Entry], than: Sequence[Entry]) -> bool:
    """Whether clearly more vehicles than under the other are upstream or in the zone at the end, seed by seed."""
    more = (difference(entries, than, f"vehicles.{where}") for where in ("waiting_to_enter", "in_zone"))
    return any(found is not None and found.mean - (found.half or 0.0) > LEFT_BEHIND for found in more)


def _met(entries: Sequence[Entry]) -> bool:
    """Whether next to nobody is left upstream."""
    waiting = figure(entries, "vehicles.waiting_to_enter")
    return waiting is not None and waiting.mean <= LEFT_BEHIND


def _left_to_gain(ours: Sequence[Entry], theirs: Sequence[Entry]) -> float:
    """By what share more vehicles would cross than under the others if all that arrived did."""
    arrived, crossed = _mean(ours, "vehicles.arrived"), _mean(theirs, "vehicles.crossed")
    return arrived / crossed - 1.0 if crossed else float("inf")


def _mean(entries: Sequence[Entry], path: str) -> float:
    found = figure(entries, path)
    return 0.0 if found is None else found.mean
