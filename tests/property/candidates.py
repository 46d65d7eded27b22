"""Candidates of one control cycle, made up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import strategies as st

from gameopt_im.core import horizon
from gameopt_im.core.horizon import HorizonRules, HorizonTask
from gameopt_im.core.kinematics import NEVER, Manner
from gameopt_im.core.planning import Stake
from gameopt_im.core.snapshot import Bools
from gameopt_im.solver.horizon_job import HorizonJob

RULES = HorizonRules(blocks=(0.5, 1.0, 2.0), trade_off=0.7, rear_gap=2.0, manner=Manner((1.0, 3.4), 0.5, 0.9))
PLAY_MPS = 1e-3


def cut(lanes: Sequence[int], longest: int) -> tuple[tuple[int, ...], Bools]:
    """The lanes' platoons if none may be longer than this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(horizon, "LONGEST", longest)
        return horizon.platoons(lanes)


@st.composite
def contests(draw: st.DrawFn) -> list[HorizonJob]:
    """Candidates of one task: slots that differ here and there, delays that lie about as far apart as J does."""
    lanes = draw(st.lists(st.integers(1, 5), min_size=1, max_size=3))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = sum(lanes)
    s = np.concatenate([np.cumsum(random.uniform(12.0, 40.0, lane)) for lane in lanes])
    counts, trails = cut(lanes, draw(st.integers(1, 5)))
    top = random.uniform(12.0, 20.0, n)
    task = HorizonTask(
        counts=counts, s=s, v=top * random.uniform(0.3, 1.0, n), length=np.full(n, 5.0), a=random.uniform(1.0, 2.5, n),
        b=np.full(n, 4.5), top=top, line_cap=top * random.choice([0.6, 1.0], n), ps=random.uniform(0.8, 5.0, n),
        pv=random.uniform(0.5, 2.5, n), room=np.full((n, len(RULES.blocks)), NEVER),
        trails=trails,
    )  # fmt: skip
    slots = s / top + np.concatenate([np.cumsum(random.uniform(0.5, 3.0, lane)) for lane in lanes])
    spread = draw(st.sampled_from([0.0, 0.1, 3.0]))
    made = []
    for k in range(draw(st.integers(1, 6))):
        moved = slots + spread * random.normal(size=n) * (random.random(n) < 0.5)
        stake = Stake(10.0 + spread * random.random(), 0.01, 0.02 if k == 0 else 0.0)
        made.append(HorizonJob(task, RULES, np.maximum(moved, s / top), PLAY_MPS, stake))
    return made


def job(slots: Sequence[float], delay: float) -> HorizonJob:
    """Two vehicles behind each other, with these slots; its predicted delay, s."""
    task = HorizonTask(
        counts=(2,), s=np.array([60.0, 80.0]), v=np.full(2, 15.0), length=np.full(2, 5.0), a=np.full(2, 2.0),
        b=np.full(2, 4.5), top=np.full(2, 20.0), line_cap=np.full(2, 20.0), ps=np.ones(2), pv=np.ones(2),
        room=np.full((2, len(RULES.blocks)), NEVER), trails=np.zeros(2, dtype=np.bool_),
    )  # fmt: skip
    return HorizonJob(task, RULES, np.array(slots), PLAY_MPS, Stake(delay, 0.01, 0.0))
