"""The joint problem of order and speeds: its rows, and SCIP's answer against every order there is."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from builders import CONFLICT, traffic

from gameopt_im.core.joint import Joint, always_before, in_order, joint
from gameopt_im.core.parameters import Program
from gameopt_im.core.program import LATERAL_PENALTY, Traffic, violations
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import Ints
from gameopt_im.solver.joint_order import solve
from gameopt_im.solver.workspace import Workspace, pattern

DT_S = 0.1
SETTINGS = Program()
STRAIGHT = (1, 4, 7, 10)
EXACT = Workspace(residual_mps=1e-5, max_iter=200_000)


def crowd(n: int, seed: int) -> Traffic:
    """Cars and trucks close to their lines on the straight movements of all roads, where nearly all pairs conflict."""
    rng = np.random.default_rng(seed)
    movement = rng.choice(STRAIGHT, n)
    place = np.array([np.count_nonzero(movement[:i] == movement[i]) for i in range(n)])
    truck = rng.random(n) < 0.2
    return traffic(
        s=rng.uniform(2.0, 25.0, n) + 25.0 * place,
        v=rng.uniform(0.0, 12.0, n),
        length=np.where(truck, 12.0, 5.0),
        speed_priority=rng.choice([0.8, 1.2, 5.0], n),
        variation_priority=np.where(truck, 2.5, 1.0),
        movement=movement,
        lane=movement,
    )


def problem(vehicles: Traffic) -> Joint:
    return joint(vehicles, CONFLICT, SETTINGS, DT_S)


def value(vehicles: Traffic, order: Ints) -> float:
    """The least objective of an order, by the program that the paper's profile solves."""
    qp = in_order(vehicles, order, CONFLICT, SETTINGS, DT_S)
    solution = EXACT.solve(pattern(qp), qp)
    assert solution is not None
    return objective(qp, solution.x)


def orders(vehicles: Traffic) -> list[Ints]:
    """Every order that keeps the lanes."""
    before = always_before(vehicles, DT_S)
    every = (np.array(order) for order in permutations(range(len(vehicles))))
    return [order for order in every if not np.tril(before[np.ix_(order, order)]).any()]


def pairs(vehicles: Traffic) -> set[tuple[int, int]]:
    rows = problem(vehicles).lateral
    return set(zip(rows.source.tolist(), rows.target.tolist(), strict=True))


def test_a_conflicting_pair_has_a_row_for_either_order() -> None:
    assert pairs(traffic(s=[20.0, 30.0, 40.0], movement=[1, 7, 2], lane=[1, 7, 2])) == {(0, 1), (1, 0), (1, 2), (2, 1)}


def test_who_is_inside_is_through_first_whatever_the_order() -> None:
    vehicles = traffic(s=[40.0, 0.4], movement=[1, 7])  # at 10 m/s the second passes its line in this very step
    assert pairs(vehicles) == {(1, 0)}
    assert always_before(vehicles, DT_S).tolist() == [[False, False], [True, False]]


def test_lanes_are_kept() -> None:
    vehicles = traffic(s=[30.0, 10.0, 20.0], movement=[1, 1, 7], lane=[1, 1, 7])
    assert np.argwhere(always_before(vehicles, DT_S)).tolist() == [[1, 0]]
    assert np.argwhere(np.triu(problem(vehicles).free)).tolist() == [[0, 2], [1, 2]]


def test_left_sides_stay_between_their_least_and_most() -> None:
    made = problem(crowd(6, seed=1))
    rows = made.lateral
    for u in np.random.default_rng(2).uniform(made.lower, made.upper, (50, 6)):
        left = rows.c_target * u[rows.target] - rows.c_source * u[rows.source] - rows.bound
        assert (left >= made.least - 1e-9).all()
        assert (left <= made.most + 1e-9).all()


def test_an_order_costs_the_slack_of_its_rows() -> None:
    vehicles = traffic(s=[20.0, 21.0], v=[5.0, 5.0], movement=[1, 7])
    made, answer = problem(vehicles), solve(problem(vehicles), 10.0)
    assert answer.order is not None
    assert answer.order.tolist() == [0, 1]
    slack = violations(made.lateral, np.array([made.upper[0], made.lower[1]]))[0]
    linear, quadratic = LATERAL_PENALTY
    assert answer.objective > linear * slack + quadratic * slack**2


@pytest.mark.parametrize(("n", "seed"), [(2, 1), (3, 2), (4, 3), (5, 5), (6, 6), (7, 1), (8, 1)])
def test_the_answer_is_the_best_of_all_orders_that_keep_the_lanes(n: int, seed: int) -> None:
    vehicles = crowd(n, seed)
    answer = solve(problem(vehicles), 60.0)
    values = [value(vehicles, order) for order in orders(vehicles)]
    assert len(values) > 1
    assert max(values) > min(values) * 1.001  # the order matters
    assert answer.optimal
    assert answer.order is not None
    assert not np.tril(always_before(vehicles, DT_S)[np.ix_(answer.order, answer.order)]).any()
    assert answer.objective == pytest.approx(min(values), rel=1e-5)
    assert answer.bound == pytest.approx(min(values), rel=1e-5)
    assert value(vehicles, answer.order) == pytest.approx(min(values), rel=1e-5)


def test_a_limit_of_time_is_kept_and_said() -> None:
    answer = solve(problem(crowd(24, seed=7)), 0.01)
    assert not answer.optimal
    assert answer.bound <= answer.objective
