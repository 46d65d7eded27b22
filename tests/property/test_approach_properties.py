"""The cruise speed of the closed form against the one found by bisection alone."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core.kinematics import BISECTIONS, TOO_SOFT_S, cruise_for, peak_speed, plan_at

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
