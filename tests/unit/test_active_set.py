"""One program by the active set: who drives ahead, and what a good guess is worth. All else are properties."""

from __future__ import annotations

import numpy as np
import pytest

from gameopt_im.core import active_set
from gameopt_im.core.active_set import PlatoonSolution
from gameopt_im.core.horizon import MULTIPLIER, HorizonRules, HorizonTask, column_of
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.horizon_job import HorizonJob

RULES = HorizonRules(blocks=(0.5, 0.5, 1.0), trade_off=0.7, rear_gap=2.0, manner=Manner((1.0, 3.4), 0.5, 0.9))
PLAY_MPS = 1e-3
REAR_END = 3
GUESS = column_of(3, 0, 0) + MULTIPLIER * 3
"""The first column of what is guessed for a platoon of three blocks."""


def close_pair() -> Floats:
    """The one behind is faster, 9 m behind, and in a greater hurry."""
    task = HorizonTask(
        counts=(2,), s=np.array([40.0, 54.0]), v=np.array([8.0, 12.0]), length=np.full(2, 5.0), a=np.full(2, 2.0),
        b=np.full(2, 4.5), top=np.full(2, 20.0), line_cap=np.full(2, 20.0), ps=np.array([1.0, 5.0]), pv=np.ones(2),
        room=np.full((2, 3), NEVER), trails=np.zeros(2, dtype=np.bool_),
    )  # fmt: skip
    (platoon,) = HorizonJob(task, RULES, np.array([6.0, 7.0]), PLAY_MPS).programs()
    return platoon.values


def solved(values: Floats) -> PlatoonSolution:
    found = active_set.solve(values, RULES.blocks, PLAY_MPS)
    assert found is not None
    return found


def test_who_follows_minds_who_is_ahead() -> None:
    found = solved(close_pair())
    assert found.residual < 1e-6
    assert found.duals[1, REAR_END].max() > 0.0


def test_what_bound_is_right_at_once() -> None:
    values = close_pair()
    cold = solved(values)
    assert cold.steps > 3
    assert (cold.duals < 0.0).any()
    values[:, GUESS:] = cold.duals.reshape(2, -1)
    warm = solved(values)
    assert warm.steps == 0
    np.testing.assert_allclose(warm.u, cold.u, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_was_guessed_wrong_is_let_go_of(sign: float) -> None:
    """Whichever row is said to bind, at either of its bounds."""
    values = close_pair()
    cold = solved(values)
    for vehicle in range(2):
        for column in range(GUESS, values.shape[1]):
            values[:, GUESS:] = 0.0
            values[vehicle, column] = sign
            np.testing.assert_allclose(solved(values).u, cold.u, atol=1e-9)
