"""Lights for a net: the program that a plan makes of a junction's connections."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from gameopt_sumo.baselines.plan import Plan, PlanError, Stage
from gameopt_sumo.junction import Link, links_over, number_roads

PROGRAM = "gameopt"
_RANK = {"straight": 0, "right": 1, "left": 2, "turnaround": 3}
_ARROW_RANK = 4
"""Who yields to whom where two have green: straight, right, left, and last a right turn by its arrow alone."""


@dataclass(frozen=True)
class Signal:
    """One connection under the lights: its place in a phase's state, and its foes by their places."""

    index: int
    lane: str
    road: int
    intention: str
    foes: frozenset[int]


def signals(net: Any, node: Any) -> list[Signal]:
    """The connections that the lights of a junction show a signal to, if road vehicles may use them."""
    links = links_over(net, node)
    roads = number_roads(links)
    connections = [_connection(link) for link in links]
    places = [(c.getTLLinkIndex(), c.getJunctionIndex()) for c in connections]
    return [
        Signal(
            index=place,
            lane=link.lane.getID(),
            road=roads[link.approach],
            intention=link.intention,
            foes=frozenset(other for other, at in places if at != inside and node.areFoes(inside, at)),
        )
        for link, (place, inside) in zip(links, places, strict=True)
    ]


def _connection(link: Link) -> Any:
    return next(c for c in link.lane.getOutgoing() if c.getToLane() is link.exit_lane)


def program(shown: Sequence[Signal], light: str, width: int, plan: Plan) -> ET.Element:
    """The tlLogic of a plan; a phase's state has `width` places. Raises `PlanError` for a plan that does not fit.

    Every stage is followed by yellow and all red for those who lose their green; the others keep it.
    """
    axes = 1 + max(signal.road for signal in shown) // 2
    stages, greens_s = plan.stages(axes), plan.greens_s(axes)
    _own_left_lanes(shown, plan)
    states = [_state(shown, stage, plan, width) for stage in stages]
    kind = "static" if plan.method == "fixed" else "actuated"
    logic = ET.Element("tlLogic", id=light, type=kind, programID=PROGRAM, offset="0")
    if plan.method == "actuated":
        _detect(logic, shown, states, plan)
    for k, (state, green_s) in enumerate(zip(states, greens_s, strict=True)):
        green = ET.SubElement(logic, "phase", duration=f"{green_s:.1f}", state=state)
        if plan.method == "actuated":
            green.set("minDur", f"{plan.min_green_s:.1f}")
            green.set("maxDur", f"{green_s:.1f}")
        after = states[(k + 1) % len(states)]
        ET.SubElement(logic, "phase", duration=f"{plan.yellow_s:.1f}", state=_between(state, after, "y"))
        if plan.all_red_s > 0.0:
            ET.SubElement(logic, "phase", duration=f"{plan.all_red_s:.1f}", state=_between(state, after, "r"))
    return logic


def _own_left_lanes(shown: Sequence[Signal], plan: Plan) -> None:
    lefts = {signal.lane for signal in shown if signal.intention == "left"}
    others = {signal.lane for signal in shown if signal.intention in ("straight", "right")}
    if plan.left == "protected" and (shared := lefts & others):
        raise PlanError(
            f'left is "protected", but lane {min(shared)} is not for left turns alone; allowed: "permissive", "both"'
        )


def _state(shown: Sequence[Signal], stage: Stage, plan: Plan, width: int) -> str:
    """One letter a connection: G green, g green but yielding, r red."""
    ranks = {signal.index: rank for signal in shown if (rank := _rank(signal, stage, plan)) is not None}
    green = [signal for signal in shown if signal.index in ranks]
    for a, b in combinations(green, 2):
        if b.index in a.foes and ranks[a.index] == ranks[b.index]:
            raise PlanError(
                f"{stage}: lanes {a.lane} and {b.lane} would have green together, and they cross; "
                "lights are laid out for junctions with pairs of opposite roads"
            )
    letters = ["r"] * width
    for signal in green:
        yields = any(ranks[foe] < ranks[signal.index] for foe in signal.foes & ranks.keys())
        letters[signal.index] = "g" if yields else "G"
    return "".join(letters)


def _rank(signal: Signal, stage: Stage, plan: Plan) -> int | None:
    """Its rank among those with green; None where it has red."""
    left = signal.intention in ("left", "turnaround")
    if signal.road // 2 == stage.axis:
        if left and (stage.within != "straight" or plan.left == "both"):
            return _RANK[signal.intention]
        if not left and stage.within != "left":
            return _RANK[signal.intention]
    return _ARROW_RANK if signal.intention == "right" and plan.right == "always" else None


def _between(state: str, after: str, lost: str) -> str:
    """The state from one stage to the next: who loses green has `lost`, who keeps it yields if either has it yield."""
    letters = []
    for now, then in zip(state, after, strict=True):
        if now == "r" or then == "r":
            letters.append("r" if now == "r" else lost)
        else:
            letters.append("G" if now == then == "G" else "g")
    return "".join(letters)


def _detect(logic: ET.Element, shown: Sequence[Signal], states: Sequence[str], plan: Plan) -> None:
    """A lane with green in every stage would extend them all, so nobody counts on it."""
    ET.SubElement(logic, "param", key="max-gap", value=f"{plan.max_gap_s:g}")
    ET.SubElement(logic, "param", key="detector-gap", value=f"{plan.detector_gap_s:g}")
    ending = {signal.lane for signal in shown if any(state[signal.index] == "r" for state in states)}
    for lane in sorted({signal.lane for signal in shown} - ending):
        ET.SubElement(logic, "param", key=lane, value="NO_DETECTOR")
