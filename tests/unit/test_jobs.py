"""The paper's program as a job: speeds within reach, rows kept where they can be, J as the objective."""

from __future__ import annotations

import pickle
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from builders import CONFLICT, random_traffic, traffic

from gameopt_im.core import program
from gameopt_im.core.parameters import Program
from gameopt_im.core.program import Traffic
from gameopt_im.core.snapshot import Ints
from gameopt_im.solver.jobs import Outcome, PaperJob, solve, warm_up


def solved(vehicles: Traffic, order: Ints, **settings: object) -> Outcome:
    parameters = msgspec.structs.replace(Program(), **settings)
    outcome = solve(PaperJob(vehicles, order, CONFLICT, parameters))
    assert outcome is not None
    return outcome


def test_alone_a_vehicle_goes_as_fast_as_it_can() -> None:
    outcome = solved(traffic(s=[100.0], v=[10.0]), np.array([0]))
    np.testing.assert_allclose(outcome.speeds, [10.26], atol=1e-3)
    assert outcome.objective == pytest.approx(0.7 * 9.74**2 + 0.3 * 0.26**2, rel=1e-3)
    assert outcome.residual <= 1e-3


def test_the_first_of_the_sequence_goes_ahead_of_the_second() -> None:
    vehicles = traffic(s=[60.0, 60.0], v=[10.0, 10.0], movement=[1, 7])
    first, second = solved(vehicles, np.array([0, 1])), solved(vehicles, np.array([1, 0]))
    assert first.speeds[0] > first.speeds[1]
    np.testing.assert_allclose(first.speeds, second.speeds[::-1], atol=2e-3)


def test_speeds_are_within_reach_and_rear_end_rows_hold_where_they_can() -> None:
    for seed in range(5):
        vehicles, order = random_traffic(30, seed)
        outcome = solved(vehicles, order)
        lower, upper = program.boxes(vehicles, 0.1)
        assert (outcome.speeds >= lower).all()
        assert (outcome.speeds <= upper).all()
        rows = program.rear_end_rows(vehicles, 2.0, 0.1)
        apart = program.largest_feasible(np.full(30, -np.inf), upper, rows, np.lexsort((vehicles.s,)))
        assert apart is not None
        if (apart >= lower).all():
            assert program.violations(rows, outcome.speeds).max() <= 2e-3


def test_reduced_rows_have_fewer_slacks_to_pay_for() -> None:
    """Equal to the full rows on feasible states (`tests/property`); elsewhere each row given way to costs."""
    for seed in range(5):
        vehicles, order = random_traffic(15, seed)
        reduced, full = (solved(vehicles, order, lateral_rows=name) for name in ("reduced", "full"))
        assert reduced.objective <= full.objective * (1.0 + 1e-6)


def test_a_job_depends_on_itself_alone() -> None:
    vehicles, order = random_traffic(20, seed=5)
    job = PaperJob(vehicles, order, CONFLICT, Program())
    once = solve(job)
    for other in range(3):
        solve(PaperJob(replace(vehicles, v=vehicles.v * 0.3 * other), order, CONFLICT, Program()))
    again = solve(pickle.loads(pickle.dumps(job, protocol=5)))
    assert once is not None
    assert again is not None
    assert once.speeds.tobytes() == again.speeds.tobytes()
    assert (once.objective, once.residual) == (again.objective, again.residual)


def test_an_empty_intersection_needs_no_solver() -> None:
    nobody = traffic(s=[])
    assert solved(nobody, np.array([], dtype=np.int64)).speeds.shape == (0,)


def test_the_jobs_to_warm_up_on_have_solutions() -> None:
    assert all(solve(job) is not None for job in warm_up())
