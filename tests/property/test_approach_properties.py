"""What saves work in the approach law against its definition: cruise speeds, and when to go full ahead."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core.corridor import reference
from gameopt_im.core.kinematics import (
    BISECTIONS,
    TOO_SOFT_S,
    approach,
    approach_speed,
    cruise_for,
    earliest_arrival,
    manner_of,
    peak_speed,
    plan_at,
)
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.snapshot import Floats
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

SLOWEST = 0.5
Plan = tuple[float, float, float, float, float]


def bisected(
    s: float, v: float, time: float, d: float, a: float, top: float, line: float, b: float, aim: float
) -> Plan:
    """`cruise_for` by its definition: every middle is tried."""
    high = max(peak_speed(s, v, a, top, line, b), min(v, top))
    plan: Plan = plan_at(s, v, high, d, a, line, b, aim)
    if plan[4] >= time:
        return plan
    stopped: Plan = plan_at(s, v, SLOWEST, d, a, line, b, aim)
    if 0.0 <= stopped[4] <= time:
        return 0.0, stopped[1], stopped[2], 0.0, stopped[4]
    low = SLOWEST
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        arrival = plan_at(s, v, middle, d, a, line, b, aim)[4]
        if arrival < 0.0 or arrival > time:
            low = middle
        else:
            high = middle
    plan = plan_at(s, v, high, d, a, line, b, aim)
    return (*plan[:4], -1.0) if plan[4] < time - TOO_SOFT_S else plan


@given(
    s=st.floats(0.1, 150.0),
    v=st.floats(0.0, 20.0),
    late=st.floats(0.0, 40.0),
    d=st.sampled_from([1.0, 1.5, 2.25, 3.4]),
    a=st.floats(0.8, 2.5),
    top=st.floats(8.0, 20.0),
    cap=st.floats(0.4, 1.0),
    b=st.floats(2.0, 3.0),
    share=st.floats(0.3, 1.0),
)
@settings(max_examples=2000)
def test_the_closed_form_only_saves_work(
    s: float, v: float, late: float, d: float, a: float, top: float, cap: float, b: float, share: float
) -> None:
    line = cap * top
    time, aim = s / top + late, min(line, share * top)
    made, wanted = (
        cruise_for(s, v, time, d, a, top, line, b, SLOWEST, aim),
        bisected(s, v, time, d, a, top, line, b, aim),
    )
    np.testing.assert_allclose(made, wanted, rtol=1e-6, atol=1e-4)


MANNER = manner_of(Parameters().planner)
SECONDS = 10


def driven(s: float, v: float, slot: float, a: float, b: float, top: float, cap: float) -> Floats:
    """The approach law's own speeds by the seconds, asked at every step whether it has to go full ahead."""
    h, rate, *_ = approach(s, v, slot, a, b, top, cap, MANNER)
    speeds = []
    for k in range(SECONDS * 10):
        if s > 0.0:
            turn_b = min(motion.TURN_DECEL_MPS2, b)
            u = approach_speed(s, v, slot - k * STEP_S, h, rate, a, top, cap, turn_b, STEP_S)
            u = min(u, motion.turn_speed(s, v, b, STEP_S, cap))
        else:
            u = min(cap, v + a * STEP_S)
        u = max(0.0, u, v - b * STEP_S)
        s, v = s - 0.5 * STEP_S * (v + u), u
        speeds.append(u)
    return np.array(speeds[9::10])


@given(
    s=st.floats(2.0, 200.0),
    share=st.floats(0.0, 1.0),
    late=st.floats(0.0, 20.0),
    a=st.floats(1.0, 2.6),
    b=st.floats(3.0, 6.0),
    top=st.floats(8.0, 25.0),
    turn=st.floats(0.3, 1.0),
)
@settings(max_examples=500)
def test_who_has_to_go_full_ahead_is_found_by_halves(
    s: float, share: float, late: float, a: float, b: float, top: float, turn: float
) -> None:
    """Now and then it is a step off: having to go may cease for a step. Never by more than a step's acceleration."""
    v, cap = share * min(top, (2.0 * b * (s - motion.STOP_OFFSET_M)) ** 0.5), turn * top
    slot = earliest_arrival(s, v, a, top, cap, min(motion.TURN_DECEL_MPS2, b))[0] + late
    one = (np.array([each]) for each in (s, v, slot, a, b, top, cap))
    speeds, _, _ = reference(*one, MANNER, np.ones(SECONDS))
    np.testing.assert_allclose(speeds[0], driven(s, v, slot, a, b, top, cap), atol=a * STEP_S)
