"""Looking for the best plan with a fixed number of trials.

Webster's plans come first, for every way to turn left and several cycles. From the best of them, descent over one
block of coordinates after the other (cycle and left; splits; right, all red, yellow, and what actuated lights have
beside):
each coordinate is changed both ways, and the best change of the block is made if it is one for the better. Steps
halve when nothing is gained; then the search begins again from a plan drawn at random, until the budget is spent.
The same demand and budget look at the same plans, however many are tried at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import islice

import msgspec
import numpy as np

from gameopt_sumo.baselines.plan import Kind, Left, Plan, PlanError
from gameopt_sumo.baselines.webster import CYCLE_S, flow_ratios, lefts, rounded, webster
from gameopt_sumo.scenarios import FourArm

Score = tuple[float, ...]
"""What counts most comes first; less is better."""
Evaluate = Callable[[Sequence[Plan]], Sequence[Score]]

_DRAWS = 1958
"""Seed of the plans drawn at random."""
_FIRST_STEP, _LAST_STEP = 1.0, 0.25
_START_CYCLES_S = (None, 60.0, 90.0, 120.0, 170.0)
_ACTUATED_STARTS_S = tuple((cycle_s, gap_s) for cycle_s in (None, 90.0, 170.0) for gap_s in (2.5, 5.0))
"""Cycles to begin with, None for Webster's own; of actuated lights the longest cycle, and the gap that ends a green."""
_STEPS_S = {"all_red_s": (1.0, 0.0, 4.0), "yellow_s": (1.0, 3.0, 6.0)}
_ACTUATED_STEPS_S = {"max_gap_s": (1.0, 1.0, 5.0), "min_green_s": (8.0, 4.0, 60.0), "detector_gap_s": (1.0, 1.0, 4.0)}
"""Of the times beside the cycle: the first step, the least and the largest."""


def search(demand: FourArm, start: Sequence[Plan], budget: int, evaluate: Evaluate) -> dict[Plan, Score]:
    """The plans looked at, at most `budget`, with their scores, in order; the best is the least score's."""
    known: dict[Plan, Score] = {}

    def look(plans: Iterable[Plan]) -> None:
        new = dict.fromkeys(plan for plan in plans if plan not in known and feasible(plan))
        batch = list(islice(new, budget - len(known)))
        known.update(zip(batch, evaluate(batch), strict=True))

    rng = np.random.default_rng(_DRAWS)
    look(start)
    centre, step = min(known, key=known.__getitem__), _FIRST_STEP
    while len(known) < budget:
        gained = False
        for block in (_shape, _splits, _times):
            beside = [plan for plan in block(demand, centre, step) if feasible(plan)]
            look(beside)
            best = min((plan for plan in beside if plan in known), key=known.__getitem__, default=centre)
            if known[best] < known[centre]:
                centre, gained = best, True
        if not gained and step > _LAST_STEP:
            step /= 2.0
        elif not gained:
            drawn_plan = drawn(demand, centre, rng)
            look([drawn_plan])
            centre, step = (drawn_plan if drawn_plan in known else centre), _FIRST_STEP
    return known


def starts(demand: FourArm, method: Kind) -> list[Plan]:
    """Webster's plans."""
    if method == "fixed":
        return [webster(demand, method, left, cycle_s) for cycle_s in _START_CYCLES_S for left in lefts(demand)]
    return [
        msgspec.structs.replace(webster(demand, method, left, cycle_s), max_gap_s=gap_s)
        for cycle_s, gap_s in _ACTUATED_STARTS_S
        for left in lefts(demand)
    ]


def feasible(plan: Plan) -> bool:
    """Whether every stage is long enough."""
    try:
        plan.greens_s(2)
    except PlanError:
        return False
    return True


def at_bounds(plan: Plan) -> list[str]:
    """The times of a plan that lie at the least or the largest looked at: a better one may lie beyond."""
    bounds = {"cycle_s": CYCLE_S}
    bounds |= {name: (least, most) for name, (_, least, most) in _steps_s(plan).items()}
    found = []
    for name, (least, most) in bounds.items():
        value = getattr(plan, name)
        if value <= least:
            found.append(f"{name} {value:g}, the least tried")
        elif value >= most:
            found.append(f"{name} {value:g}, the largest tried")
    return found


def drawn(demand: FourArm, like: Plan, rng: np.random.Generator) -> Plan:
    """A plan drawn at random: any cycle, any way to turn left, splits about Webster's."""
    choices = lefts(demand)
    plan = webster(demand, like.method, choices[int(rng.integers(len(choices)))])
    while True:
        splits = rng.dirichlet([20.0 * share + 1.0 for share in plan.splits])
        found = msgspec.structs.replace(
            plan, cycle_s=float(round(rng.uniform(*CYCLE_S))), splits=rounded(splits.tolist())
        )
        if plan.method == "actuated":
            found = msgspec.structs.replace(found, max_gap_s=round(float(rng.uniform(1.5, 4.0)), 2))
        if feasible(found):
            return found


def _shape(demand: FourArm, plan: Plan, step: float) -> list[Plan]:
    """Other cycles, and other ways to turn left."""
    factor = 1.0 + 0.25 * step
    cycles = [_with_cycle(plan, plan.cycle_s * factor), _with_cycle(plan, plan.cycle_s / factor)]
    return cycles + [_with_left(demand, plan, left) for left in lefts(demand) if left != plan.left]


def _splits(demand: FourArm, plan: Plan, step: float) -> list[Plan]:
    """One stage longer or shorter, the others sharing what is left."""
    del demand
    found = []
    for k in range(len(plan.splits)):
        for factor in (1.0 + 0.3 * step, 1.0 / (1.0 + 0.3 * step)):
            splits = [share * (factor if k == n else 1.0) for n, share in enumerate(plan.splits)]
            found.append(msgspec.structs.replace(plan, splits=rounded(splits)))
    return found


def _times(demand: FourArm, plan: Plan, step: float) -> list[Plan]:
    """Right turns the other way, and the times beside the cycle."""
    del demand
    other = "with-straight" if plan.right == "always" else "always"
    found = [msgspec.structs.replace(plan, right=other)]
    for name, (change, least, most) in _steps_s(plan).items():
        for sign in (1.0, -1.0):
            value = min(max(getattr(plan, name) + sign * change * step, least), most)
            found.append(msgspec.structs.replace(plan, **{name: round(value, 2)}))
    return found


def _steps_s(plan: Plan) -> dict[str, tuple[float, float, float]]:
    return _STEPS_S | (_ACTUATED_STEPS_S if plan.method == "actuated" else {})


def _with_cycle(plan: Plan, cycle_s: float) -> Plan:
    return msgspec.structs.replace(plan, cycle_s=float(round(min(max(cycle_s, CYCLE_S[0]), CYCLE_S[1]))))


def _with_left(demand: FourArm, plan: Plan, left: Left) -> Plan:
    """The same cycle and, as far as the stages are the same, the same splits: an axis keeps its share."""
    other = msgspec.structs.replace(plan, left=left, all_red_s=webster(demand, plan.method, left).all_red_s)
    old, new = plan.stages(2), other.stages(2)
    ratios = flow_ratios(demand, new)
    splits = []
    for stage, ratio in zip(new, ratios, strict=True):
        axis = sum(share for at, share in zip(old, plan.splits, strict=True) if at.axis == stage.axis)
        same = [share for at, share in zip(old, plan.splits, strict=True) if at == stage]
        of_axis = sum(r for at, r in zip(new, ratios, strict=True) if at.axis == stage.axis)
        splits.append(same[0] if same else axis * ratio / of_axis)
    return msgspec.structs.replace(other, splits=rounded(splits))
