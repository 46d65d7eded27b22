"""The horizon program as a job: lanes apart, and shared by candidates that leave them their slots."""

from __future__ import annotations

import numpy as np
import pytest

from gameopt_im.core import horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.solver.horizon_job import HorizonJob, HorizonOutcome, PlatoonJob
from gameopt_im.solver.jobs import solve

RULES = HorizonRules(blocks=(0.5, 0.5, 1.0), trade_off=0.7, rear_gap=2.0, manner=Manner((1.0, 3.4), 0.5, 0.9))
TASK = HorizonTask(
    counts=(2, 1), s=np.array([60.0, 80.0, 70.0]), v=np.array([10.0, 10.0, 12.0]), length=np.full(3, 5.0),
    a=np.full(3, 2.0), b=np.full(3, 4.5), top=np.full(3, 20.0), line_cap=np.full(3, 20.0), ps=np.ones(3),
    pv=np.ones(3), room=np.full((3, 3), NEVER), trails=np.zeros(3, dtype=np.bool_),
)  # fmt: skip
SLOTS = np.array([6.0, 9.0, 7.0])


def solved(slots: np.ndarray) -> HorizonOutcome:
    outcome = solve(HorizonJob(TASK, RULES, slots, 1e-3))
    assert isinstance(outcome, HorizonOutcome)
    return outcome


def test_speeds_and_j_are_those_of_all_lanes() -> None:
    outcome = solved(SLOTS)
    third = HorizonJob(TASK, RULES, SLOTS, 1e-3).programs()[1].solve()
    assert third is not None
    assert outcome.speeds[2] == pytest.approx(12.0 + 0.2 * (third.u[0, 0] - 12.0))  # 0.1 s of the first block's 0.5 s
    assert outcome.residual >= third.residual


def test_what_was_solved_before_leaves_no_trace() -> None:
    once = solved(SLOTS)
    for later in range(10):
        solved(SLOTS + 0.01 * later)
    again = solved(SLOTS)
    assert (once.speeds.tobytes(), once.objective) == (again.speeds.tobytes(), again.objective)


def test_a_program_without_a_solution_has_none() -> None:
    job = HorizonJob(TASK, RULES, SLOTS, 1e-3).programs()[0]
    crossed = job.values.copy()
    crossed[:, 5 + 3] = 1e6  # the first row's lower bound
    assert PlatoonJob(crossed, RULES.blocks, 1e-3).solve() is None


def test_a_guess_leads_to_the_same_solution() -> None:
    cold = solved(SLOTS)
    warm = solve(HorizonJob(TASK, RULES, SLOTS, 1e-3, guess=cold.duals))
    assert warm is not None
    np.testing.assert_allclose(warm.speeds, cold.speeds, atol=1e-9)
    assert warm.objective == pytest.approx(cold.objective)


def test_nothing_is_guessed_of_newcomers() -> None:
    duals = solved(SLOTS).duals
    carried = horizon.carried_over(duals, np.array([2, -1, 0]))
    assert duals[[0, 2]].any(axis=(1, 2)).all()
    np.testing.assert_array_equal(carried[[0, 2]], duals[[2, 0]])
    assert not carried[1].any()
