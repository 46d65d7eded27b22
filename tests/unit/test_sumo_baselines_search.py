"""The search spends its budget, finds what is to be found, and looks at the same plans every time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from gameopt_sumo.baselines.plan import BaselineError, Kind, Plan, Stage
from gameopt_sumo.baselines.search import Score, at_bounds, feasible, search, starts
from gameopt_sumo.baselines.tuning import read_search, tune
from gameopt_sumo.baselines.webster import flow_ratios, webster
from gameopt_sumo.scenarios import FourArm

DEMAND = FourArm(flow_veh_h=3600.0, ratio=2.0)


def bowl(plan: Plan) -> Score:
    """Best: a cycle of 77 s, half of its green for the first stage, and a way to turn left of its own."""
    away = (
        abs(plan.cycle_s - 77.0)
        + 100.0 * abs(plan.splits[0] - 0.5)
        + 5.0 * (plan.left != "both")
        + abs(plan.all_red_s - 2.0)
    )
    return float(plan.right != "always"), away + abs(plan.max_gap_s - 2.0) + abs(plan.all_red_s - 2.0)


def found(budget: int, method: Kind = "fixed", score: Callable[[Plan], Score] = bowl) -> dict[Plan, Score]:
    def evaluate(plans: Sequence[Plan]) -> list[Score]:
        return [score(plan) for plan in plans]

    return search(DEMAND, starts(DEMAND, method), budget, evaluate)


@pytest.mark.parametrize("method", ["fixed", "actuated"])
def test_the_search_finds_the_bottom(method: Kind) -> None:
    known = found(150, method)
    best = min(known, key=known.__getitem__)
    assert best.cycle_s == pytest.approx(77.0, abs=3.0)
    assert best.splits[0] == pytest.approx(0.5, abs=0.03)
    assert (best.left, best.right) == ("both", "always")
    assert known[best][1] < 0.3 * min(map(bowl, starts(DEMAND, method)))[1]


def test_a_larger_budget_goes_on_where_a_smaller_one_ended() -> None:
    small, large = found(40), found(90)
    assert len(small) == 40
    assert len(large) == 90
    assert list(large)[:40] == list(small)


def test_no_plan_is_looked_at_twice_and_every_one_can_be_driven() -> None:
    asked: list[Plan] = []

    def score(plan: Plan) -> Score:
        asked.append(plan)
        return bowl(plan)

    found(120, score=score)
    assert len(asked) == len(set(asked)) == 120
    assert all(feasible(plan) for plan in asked)
    assert {plan.left for plan in asked} == {"protected", "permissive", "both"}
    assert {plan.right for plan in asked} == {"always", "with-straight"}
    assert min(plan.cycle_s for plan in asked) >= 25.0
    assert max(plan.cycle_s for plan in asked) <= 170.0


def test_short_cycles_short_yellow_and_no_all_red_are_looked_at() -> None:
    """Short cycles, yellow of 3 s and no all red, if they are better."""

    def short(plan: Plan) -> Score:
        return (plan.cycle_s + 10.0 * (plan.yellow_s + plan.all_red_s),)

    known = found(400, score=short)
    best = min(known, key=known.__getitem__)
    assert (best.yellow_s, best.all_red_s) == (3.0, 0.0)
    assert best.cycle_s < 30.0


def test_a_plan_at_a_bound_of_the_search_is_told() -> None:
    plan = webster(DEMAND, "fixed", "protected", 90.0)
    assert at_bounds(plan) == []
    assert at_bounds(msgspec.structs.replace(plan, cycle_s=170.0, all_red_s=0.0)) == [
        "cycle_s 170, the largest tried",
        "all_red_s 0, the least tried",
    ]
    assert at_bounds(msgspec.structs.replace(plan, max_gap_s=5.0)) == [], "fixed lights have no gap"
    assert at_bounds(msgspec.structs.replace(plan, method="actuated", max_gap_s=5.0)) == [
        "max_gap_s 5, the largest tried"
    ]


def test_where_nothing_is_better_the_search_starts_again_elsewhere() -> None:
    known = found(120, score=lambda _plan: (0.0, 1.0))
    assert len({plan.cycle_s for plan in known}) > 15


def test_webster_by_hand() -> None:
    """3,600 veh/h, 2:1: 1,200 veh/h from west; half of it straight on, a quarter left; 1,800 veh/h a lane."""
    stages = [Stage(0, "straight"), Stage(0, "left"), Stage(1, "straight"), Stage(1, "left")]
    assert flow_ratios(DEMAND, stages) == pytest.approx([1 / 3, 1 / 6, 1 / 6, 1 / 12])
    plan = webster(DEMAND, "fixed", "protected")
    assert plan.cycle_s == round((1.5 * 20.0 + 5.0) / (1.0 - 0.75))
    assert plan.splits == pytest.approx([4 / 9, 2 / 9, 2 / 9, 1 / 9], abs=0.001)


@pytest.mark.parametrize("ratio", [1.0, 4.0, 100.0])
@pytest.mark.parametrize("flow", [200.0, 5200.0, 16_000.0])
@pytest.mark.parametrize("method", ["fixed", "actuated"])
def test_every_start_can_be_driven(flow: float, ratio: float, method: Kind) -> None:
    assert all(feasible(plan) for plan in starts(FourArm(flow_veh_h=flow, ratio=ratio), method))


def test_the_record_of_another_search_is_refused(tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text('{"turns": [0.25, 0.5, 0.25], "method": "fixed"}')
    with pytest.raises(BaselineError, match="holds a search with arm_flows_veh_h None"):
        tune(DEMAND, "fixed", (201,), 1, 60.0, 0.0, 1, tmp_path)


def test_a_broken_record_is_refused_and_a_cut_line_dropped(tmp_path: Path) -> None:
    file = tmp_path / "search.jsonl"
    assert read_search(file) == []
    file.write_bytes(b'{"number":0,"plan"')
    assert read_search(file) == []
    assert file.read_bytes() == b""
    file.write_bytes(b'{"number":0}\n')
    with pytest.raises(BaselineError, match="not the record of a search"):
        read_search(file)
