"""One program by the active set: who drives ahead, and what a good guess is worth. All else are properties."""

from __future__ import annotations

import numpy as np

from gameopt_im.core import horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask, Programmed
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.solver import active_set
from gameopt_im.solver.horizon_job import HorizonJob

RULES = HorizonRules(blocks=(0.5, 0.5, 1.0), trade_off=0.7, rear_gap=2.0, manner=Manner((1.0, 3.4), 0.5, 0.9))
PLAY_MPS = 1e-3


def close_pair() -> Programmed:
    """The one behind is faster, 9 m behind, and in a greater hurry."""
    task = HorizonTask(
        counts=(2,), s=np.array([40.0, 54.0]), v=np.array([8.0, 12.0]), length=np.full(2, 5.0), a=np.full(2, 2.0),
        b=np.full(2, 4.5), top=np.full(2, 20.0), line_cap=np.full(2, 20.0), ps=np.array([1.0, 5.0]), pv=np.ones(2),
        room=np.full((2, 3), NEVER), trails=np.zeros(2, dtype=np.bool_),
    )  # fmt: skip
    (platoon,) = HorizonJob(task, RULES, np.array([6.0, 7.0]), PLAY_MPS).programs()
    return horizon.program(platoon.values, platoon.blocks)


def test_who_follows_minds_who_is_ahead() -> None:
    given = close_pair()
    solution = active_set.solve(given, RULES.blocks, PLAY_MPS)
    assert solution is not None
    assert solution.residual < 1e-6
    assert solution.y[3 * 2 * 3 :].max() > 0.0  # a row of the fourth kind binds


def test_what_bound_is_right_at_once() -> None:
    given = close_pair()
    cold = active_set.solve(given, RULES.blocks, PLAY_MPS)
    assert cold is not None
    assert cold.iterations > 3
    assert (cold.y < 0.0).any()
    warm = active_set.solve(given._replace(y=cold.y), RULES.blocks, PLAY_MPS)
    assert warm is not None
    assert warm.iterations <= 2
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-9)
