"""The switches that make methods and ablations of the default profile: each does what it says, and only that."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_slots import demand

from gameopt_im import config
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import INCUMBENT, Bidders, Candidate, candidates, select
from gameopt_im.manager import Manager, Outcome
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Command

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
STRAIGHT_S, LEFT_S = [80.0, 95.0], [90.0, 105.0]
"""Two lanes that conflict, the first with vehicles 0 and 1, the other with 2 and 3."""
BIDS = np.array([[0.1, 0.9, 0.5, 0.2], [0.9, 0.9, 0.1, 0.1]])
INCUMBENT_ORDER = [2, 3, 0, 1]


def orders(text: str, arrival: list[int] | None = None) -> dict[int, list[int]]:
    """The candidates under a configuration, by weight vector."""
    problem = demand(STRAIGHT_S, LEFT_S)
    if arrival is not None:
        problem = problem._replace(arrival=np.array(arrival))
    who = Bidders(np.arange(4), (2, 2), BIDS, np.zeros(4, dtype=np.int64))
    made = candidates(problem, who, np.ones(4), np.zeros(4), INCUMBENT_ORDER, config.parse(text))
    return {each.weights: each.order.tolist() for each in made}


def test_sorted_bids_alone_make_the_order_and_lanes_are_kept() -> None:
    made = orders('[auction]\norder = "sorted"')
    # 1 bids most but stands behind 0, who bids least: 2 and 3 go before both.
    assert made == {INCUMBENT: INCUMBENT_ORDER, 1: [0, 1, 2, 3]}
    assert orders('[auction]\norder = "sorted"\n[planner]\nincumbent = false') == {0: INCUMBENT_ORDER, 1: [0, 1, 2, 3]}


def test_first_come_first_served_whatever_anybody_bids() -> None:
    fifo = '[auction]\norder = "arrival"\n[planner]\nincumbent = false'
    assert orders(fifo) == {0: [0, 1, 2, 3]}
    assert orders(fifo, arrival=[1, 3, 0, 2]) == {0: [2, 0, 3, 1]}


def test_slots_of_a_given_order_are_those_of_the_incumbent_in_that_order() -> None:
    problem = demand(STRAIGHT_S, LEFT_S)
    who = Bidders(np.arange(4), (2, 2), BIDS, np.zeros(4, dtype=np.int64))
    fifo = config.parse('[auction]\norder = "arrival"\n[planner]\nincumbent = false')
    (first_come,) = candidates(problem, who, np.ones(4), np.zeros(4), INCUMBENT_ORDER, fifo)
    incumbent = candidates(problem, who, np.ones(4), np.zeros(4), [0, 1, 2, 3], Parameters())[0]
    np.testing.assert_array_equal(first_come.slots, incumbent.slots)
    np.testing.assert_array_equal(first_come.lines, incumbent.lines)


def test_without_the_incumbent_the_others_are_what_they_were() -> None:
    usual = orders("")
    without = orders("[planner]\nincumbent = false")
    assert INCUMBENT in usual
    assert INCUMBENT not in without
    assert {k: order for k, order in usual.items() if k != INCUMBENT}.items() <= without.items()


def of_delays(*delays: float) -> list[Candidate]:
    nothing = np.empty(0)
    return [Candidate(k, np.empty(0, dtype=np.int64), nothing, nothing, delay) for k, delay in enumerate(delays)]


def test_selection_by_the_objective_looks_at_nothing_else() -> None:
    options = of_delays(0.0, 10.0, 20.0)
    by_objective = config.parse('[planner]\nselection = "objective"')
    assert select(options, [9.0, 8.0, 7.0], by_objective) == 2
    assert select(options, [9.0, 8.0, 7.0], Parameters()) == 0


def test_without_programs_the_delay_decides_whatever_else_would() -> None:
    options = of_delays(2.0, 1.0, 3.0)
    by_objective = config.parse('[planner]\nselection = "objective"')
    assert select(options, [0.0, 0.0, 0.0], by_objective, solved=False) == 1


async def driven(text: str, cycles: int) -> list[Outcome]:
    """A junction of two roads under a configuration."""
    options = ServeOptions(map=ROADS, parameters=config.parse(text), clock="lockstep", workers=0)
    traffic, outcomes = Rehearsal(ROADS, 12), []
    async with solver_of(options) as pool:
        manager = Manager(options, 1, pool)
        for cycle in range(1, cycles):
            outcomes.append(await manager.control_cycle(cycle, cycle / 10, traffic.messages(cycle / 10)))
            traffic.obey(outcomes[-1].commands)
    return outcomes


def offers(outcomes: list[Outcome]) -> list[Command]:
    """The first offer to each vehicle."""
    commands = [each for outcome in outcomes for each in outcome.commands if each.clearance is not None]
    return list({each.vehicle: each for each in reversed(commands)}.values())


@pytest.mark.parametrize(
    "text",
    [
        "[program]\nsolve = false",
        "[program]\nsolve = false\n[planner]\nupstream = false",
        '[planner]\nselection = "objective"',
        '[interlock]\nask = "rule"',
        '[auction]\norder = "arrival"\n[planner]\nincumbent = false',
    ],
)
def test_vehicles_get_through_and_programs_are_solved_where_they_should(text: str) -> None:
    outcomes = asyncio.run(driven(text, 200))
    solved = outcomes[-1].report.qp_solved_total
    assert (solved == 0) == ("solve = false" in text)
    assert len(offers(outcomes)) > 10


def test_asked_by_rule_1_alone_clearances_come_later() -> None:
    def ahead_s(text: str) -> float:
        made = offers(asyncio.run(driven(text, 200)))
        return float(np.median([each.slot_s - each.time_s for each in made if each.slot_s is not None]))

    assert ahead_s('[interlock]\nask = "rule"') < ahead_s("") - 1.0


def test_who_does_not_wait_upstream_is_sooner_at_its_line() -> None:
    """The second in the order could be there with the first: it drives on and stops, or keeps back."""
    upstream, at_the_line = (
        asyncio.run(driven("[program]\nsolve = false\n" + more, 60)) for more in ("", "[planner]\nupstream = false")
    )
    fast, slow = (
        np.mean([command.speed_mps for outcome in run for command in outcome.commands if command.cleared is None])
        for run in (at_the_line, upstream)
    )
    assert fast > slow
