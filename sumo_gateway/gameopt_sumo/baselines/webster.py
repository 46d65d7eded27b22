"""Where a search starts: Webster's signal plans for a four-arm demand.

F. V. Webster, Traffic Signal Settings, Road Research Technical Paper 39, 1958.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from gameopt_sumo.baselines.plan import Kind, Left, Plan, Stage
from gameopt_sumo.demand import ARMS, lane_of
from gameopt_sumo.scenarios import FourArm

SATURATION_VEH_H = 1800.0
"""What a lane lets through in an hour of green."""
CYCLE_S = (25.0, 170.0)
"""Shortest and longest cycle looked at."""
CLEARING_S = 2.0
"""All red after left turns through gaps: with 1 s, trucks that used the last gap were still on their way out."""
_LEAST_FLOW_RATIO = 0.02
_LONGEST_AT = 0.97
"""From this sum of flow ratios on, Webster's cycle is beyond all bounds."""


def lefts(demand: FourArm) -> tuple[Left, ...]:
    """Ways to turn left that the lanes allow: only a lane of their own may wait for a stage of its own."""
    own_lane = lane_of(2, demand.lanes) != lane_of(1, demand.lanes)
    return ("protected", "permissive", "both") if own_lane else ("permissive",)


def flow_ratios(demand: FourArm, stages: Sequence[Stage]) -> list[float]:
    """y of each stage: the largest flow of a lane that has green in it, over the saturation flow."""
    ratios = []
    for stage in stages:
        roads = [demand.flow_by_arm_veh_h[arm] for arm in ARMS[2 * stage.axis : 2 * stage.axis + 2]]
        served = {"straight": (0, 1), "left": (2,), "all": (0, 1, 2)}[stage.within]
        lanes = dict.fromkeys((lane_of(1, demand.lanes), lane_of(2, demand.lanes)), 0.0)
        for intention in served:
            lane = lane_of(intention, demand.lanes)
            if lane in lanes:  # a right turn's own lane asks for no green
                lanes[lane] += demand.turns[intention]
        ratios.append(max(_LEAST_FLOW_RATIO, max(roads) * max(lanes.values()) / SATURATION_VEH_H))
    return ratios


def webster(demand: FourArm, method: Kind, left: Left, cycle_s: float | None = None) -> Plan:
    """Webster's cycle C = (1.5 L + 5) / (1 - Y), or one that is given, and splits in proportion to y.

    L is the time lost to yellow and all red, Y the sum of the y. No cycle is too short for every stage's least green.
    """
    plan = Plan(
        method=method,
        cycle_s=CYCLE_S[1],
        splits=(1.0,),
        left=left,
        all_red_s=CLEARING_S if left == "permissive" else 1.0,
    )
    stages = plan.stages(2)
    ratios = flow_ratios(demand, stages)
    lost_s, total = len(stages) * (plan.yellow_s + plan.all_red_s), sum(ratios)
    if cycle_s is None:
        cycle_s = (1.5 * lost_s + 5.0) / (1.0 - min(total, _LONGEST_AT))
    shortest_s = max(CYCLE_S[0], lost_s + len(stages) * plan.min_green_s)
    cycle_s = float(round(min(max(cycle_s, shortest_s), CYCLE_S[1])))
    least = min(plan.min_green_s / (cycle_s - lost_s), 1.0 / len(stages))
    return msgspec.structs.replace(plan, cycle_s=cycle_s, splits=rounded(_at_least(ratios, least)))


def _at_least(ratios: Sequence[float], least: float) -> list[float]:
    """Shares in proportion to `ratios`, but for those that would be below `least`."""
    low: set[int] = set()
    while True:
        rest = sum(ratio for k, ratio in enumerate(ratios) if k not in low)
        left = 1.0 - least * len(low)
        shares = [least if k in low else left * ratio / rest for k, ratio in enumerate(ratios)]
        lower = {k for k, share in enumerate(shares) if share < least - 1e-9}
        if not lower:
            return shares
        low |= lower


def rounded(splits: Sequence[float]) -> tuple[float, ...]:
    """Shares to three places that add up to 1."""
    total = sum(splits)
    shares = [round(share / total, 3) for share in splits]
    shares[-1] = round(1.0 - sum(shares[:-1]), 3)
    return tuple(shares)
