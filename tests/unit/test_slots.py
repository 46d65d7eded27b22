"""Slots and the dispatch auction on two conflicting lanes, one straight on and one turning, and the choice of q*."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from gameopt_im.core.dispatch import schedule
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import INCUMBENT, Bidders, Candidate, candidates, rules_of, select
from gameopt_im.core.slots import Demand, Rules, course_of

STRAIGHT, LEFT = 0, 1
BOX_M = 25.0
LENGTH_M = 5.0
RULES = rules_of(Parameters())


def demand(straight_s: Sequence[float], left_s: Sequence[float]) -> Demand:
    """Cars at 20 m/s at these distances on each lane; lefts cross at 10 m/s, and each keeps the whole box."""
    s = np.array([*straight_s, *left_s])
    n = len(s)
    movement = np.array([STRAIGHT] * len(straight_s) + [LEFT] * len(left_s))
    windows = np.full((2, 1, 2, 1, 2), np.nan)
    windows[STRAIGHT, 0, LEFT, 0] = windows[LEFT, 0, STRAIGHT, 0] = (0.0, BOX_M)
    queue = np.full((2, max(len(straight_s), len(left_s))), -1, dtype=np.int64)
    queue[0, : len(straight_s)] = np.arange(len(straight_s))
    queue[1, : len(left_s)] = np.arange(len(straight_s), n)
    cap = np.where(movement == LEFT, 10.0, 20.0)
    full = np.ones(n)
    return Demand(
        s=s, v=20.0 * full, length=LENGTH_M * full, a=2.0 * full, b=4.5 * full, top=20.0 * full,
        line_cap=cap, cross_top=cap, movement=movement, footprint=np.zeros(n, dtype=np.int64), lane=movement.copy(),
        queue=queue, arrival=np.arange(n), floor=np.full(2, -1e9), windows=windows, blocked=np.full((n, 0, 4), np.nan),
    )  # fmt: skip


def dispatched(problem: Demand, rules: Rules) -> tuple[list[int], np.ndarray]:
    order, slots, _ = schedule(
        problem, rules, course_of(problem), np.zeros(len(problem.s)), np.arange(len(problem.s)), True
    )
    return order.tolist(), slots


def test_vehicles_of_one_lane_follow_at_their_headway() -> None:
    at_full_speed = RULES._replace(manner=RULES.manner._replace(line_share=1.0))
    order, slots = dispatched(demand([100.0, 105.0, 110.0], []), at_full_speed)
    assert order == [0, 1, 2]
    assert slots[0] == pytest.approx(100.0 / 20.0)
    assert np.diff(slots) == pytest.approx([(LENGTH_M + 2.0) / 20.0 + RULES.headway_s] * 2)


def test_ties_go_by_arrival() -> None:
    problem = demand([100.0], [100.0])._replace(line_cap=np.full(2, 20.0), cross_top=np.full(2, 20.0))
    assert dispatched(problem, RULES)[0] == [0, 1]
    assert dispatched(problem._replace(arrival=np.array([1, 0])), RULES)[0] == [1, 0]


def test_a_conflicting_vehicle_comes_when_the_box_is_clear() -> None:
    order, slots = dispatched(demand([80.0], [120.0]), RULES)
    assert order == [0, 1]
    assert slots[1] >= slots[0] + (BOX_M + LENGTH_M) / 20.0 + RULES.margin_s - 1e-6


def test_a_turn_that_would_part_a_platoon_waits_for_what_it_costs() -> None:
    """The left could be at its line a little before the three cars, and would hold the box for 3 s."""
    problem = demand([112.0, 120.0, 128.0], [90.0])
    eager, eager_slots = dispatched(problem, RULES._replace(hold_weight=0.0))
    patient, patient_slots = dispatched(problem, RULES)
    assert eager[0] == 3
    assert patient == [0, 1, 2, 3]
    assert patient_slots.sum() < eager_slots.sum()


def test_who_overstays_wins_in_the_sequences_that_count_it() -> None:
    problem = demand([112.0, 120.0, 128.0], [90.0])
    who = Bidders(np.arange(4), (3, 1), np.zeros((3, 4)), np.zeros(4, dtype=np.int64))
    parameters = Parameters()
    waited = np.array([1.0, 1.0, 1.0, parameters.planner.patience_s + 30.0])
    made = candidates(problem, who, np.ones(4), waited, [0, 1, 2, 3], parameters)
    first = {candidate.weights: int(candidate.order[0]) for candidate in made}
    assert first[INCUMBENT] == 0
    assert first[1] == 3  # the second weight vector's impatience is not zero
    best = select(made, [0.0] * len(made), parameters)
    assert best is not None
    assert made[best].order[0] == 3


def test_without_a_weight_on_starvation_the_least_delay_decides() -> None:
    problem = demand([112.0, 120.0, 128.0], [90.0])
    who = Bidders(np.arange(4), (3, 1), np.zeros((3, 4)), np.zeros(4, dtype=np.int64))
    planner = msgspec.structs.replace(Parameters().planner, starvation_weight=0.0)
    parameters = msgspec.structs.replace(Parameters(), planner=planner)
    waited = np.array([1.0, 1.0, 1.0, planner.patience_s + 30.0])
    made = candidates(problem, who, np.ones(4), waited, [0, 1, 2, 3], parameters)
    best = select(made, [0.0] * len(made), parameters)
    assert best is not None
    assert made[best].order.tolist() == [0, 1, 2, 3]


def candidate(number: int, delay: float) -> Candidate:
    nothing = np.empty(0)
    return Candidate(number, np.empty(0, dtype=np.int64), nothing, nothing, delay)


def test_a_candidate_without_a_solution_is_out_and_the_incumbent_has_a_bonus() -> None:
    parameters = Parameters()
    bonus = parameters.planner.incumbent_bonus
    options = [candidate(INCUMBENT, 100.0), candidate(0, 100.0 * (1.0 - 0.5 * bonus)), candidate(1, 50.0)]
    assert select(options, [0.0, 0.0, None], parameters) == 0
    assert select(options, [None, 0.0, None], parameters) == 1
    assert select(options, [0.0, 0.0, 0.0], parameters) == 2
    assert select(options, [None] * 3, parameters) is None
