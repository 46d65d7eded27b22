"""Rule 2 behind leaders, where its root is only drawn if it has to be."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from gameopt_im.core.leading import room_of
from gameopt_im.core.profiles import STOP_PLAY_M, follow
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

SPEEDS = st.floats(0.0, 25.0)
BRAKES = st.floats(1.0, 9.0)


def rule(gap: float, v: float, b: float, lead_v: float, lead_b: float) -> float:
    return motion.follow_speed(gap, v, b, lead_v, lead_b, STEP_S)


@given(gap=st.floats(-20.0, 120.0), v=SPEEDS, b=BRAKES, u=SPEEDS, lead_v=SPEEDS, lead_b=BRAKES)
@example(gap=10.0, v=10.0, b=4.5, u=rule(10.0, 10.0, 4.5, 10.0, 4.5), lead_v=10.0, lead_b=4.5)
@example(gap=0.0, v=0.0, b=4.5, u=0.0, lead_v=0.0, lead_b=4.5)
def test_what_is_surely_allowed_is_what_the_rule_allows(
    gap: float, v: float, b: float, u: float, lead_v: float, lead_b: float
) -> None:
    room = room_of(np.array([gap]), np.array([lead_v]), lead_b, 0.0, -np.inf)
    most, floor = rule(gap, v, b, lead_v, lead_b), v - b * STEP_S
    possible = most >= floor or rule(gap + STOP_PLAY_M, v, b, lead_v, lead_b) >= floor
    assert follow(0.0, v, b, u, 0, room) == (min(u, most), possible)
