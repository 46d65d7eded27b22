"""The rules of motion, driven step by step: what each promises holds, and no more speed would do."""

from __future__ import annotations

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

speeds = st.floats(0.0, 30.0)
brakes = st.floats(2.0, 8.0)
STOP_PLAY_M = 0.02
"""A ballistic stop that ends within a step goes up to b dt^2 / 8 further than the continuous one."""


def advance(position: float, v: float, u: float) -> float:
    """The way of one ballistic step."""
    return position + 0.5 * STEP_S * (v + u)


@given(s=st.floats(1.0, 300.0), v=speeds, b=brakes)
def test_an_uncleared_vehicle_stops_before_the_line(s: float, v: float, b: float) -> None:
    assume(motion.stop_speed(s, v, b, STEP_S) >= v - b * STEP_S)
    x = 0.0
    for _ in range(2000):
        u = max(0.0, v - b * STEP_S, min(v + 3.0 * STEP_S, motion.stop_speed(s - x, v, b, STEP_S)))
        x, v = advance(x, v, u), u
    assert v == 0.0
    assert s - motion.STOP_OFFSET_M - 1.0 <= x <= s - motion.STOP_OFFSET_M + STOP_PLAY_M or s < 2.0


@given(s=st.floats(5.0, 300.0), v=st.floats(1.0, 30.0), b=brakes)
def test_riding_rule_1s_curve_stays_on_it(s: float, v: float, b: float) -> None:
    """From the largest speed allowed, braking fully is exactly what the rule asks for in the next step."""
    u = motion.stop_speed(s, v, b, STEP_S)
    assume(b * STEP_S < u)
    after = s - 0.5 * STEP_S * (v + u)
    again = motion.stop_speed(after, u, b, STEP_S)
    assert abs(again - (u - b * STEP_S)) < 1e-6


@settings(max_examples=200)
@given(gap=st.floats(0.0, 100.0), v=speeds, b=brakes, lead_v=speeds, lead_b=brakes)
def test_a_follower_stops_behind_a_braking_leader(gap: float, v: float, b: float, lead_v: float, lead_b: float) -> None:
    assume(motion.follow_speed(gap, v, b, lead_v, lead_b, STEP_S) >= max(0.0, v - b * STEP_S))
    x, lead = 0.0, gap
    for _ in range(400):
        rule = motion.follow_speed(lead - x, v, b, lead_v, lead_b, STEP_S)
        u = max(0.0, v - b * STEP_S, min(v + 3.0 * STEP_S, rule))
        lead_u = max(0.0, lead_v - lead_b * STEP_S)
        x, v = advance(x, v, u), u
        lead, lead_v = advance(lead, lead_v, lead_u), lead_u
        assert lead - x >= -STOP_PLAY_M
    assert v == 0.0


def test_the_weaker_brake_counts() -> None:
    """With a weak leader and a strong follower, the leader's brake is the one that is planned with, and vice versa."""
    both_weak = motion.follow_speed(30.0, 20.0, 3.0, 15.0, 3.0, STEP_S)
    assert motion.follow_speed(30.0, 20.0, 6.0, 15.0, 3.0, STEP_S) == both_weak
    assert motion.follow_speed(30.0, 20.0, 3.0, 15.0, 6.0, STEP_S) < both_weak


@given(s=st.floats(0.5, 200.0), v=st.floats(5.0, 25.0), b=brakes, turn=st.floats(3.0, 12.0))
def test_the_turning_speed_is_reached_at_the_line(s: float, v: float, b: float, turn: float) -> None:
    gentle = min(motion.TURN_DECEL_MPS2, b)
    assume(v <= turn or (v * v - turn * turn) / (2.0 * gentle) <= s)
    while s > 0.0:
        u = max(v - b * STEP_S, min(v + 2.0 * STEP_S, motion.turn_speed(s, v, b, STEP_S, turn)))
        s, v = s - 0.5 * STEP_S * (v + u), u
    assert v <= turn + gentle * STEP_S
    assert motion.turn_speed(-1.0, v, b, STEP_S, turn) == turn


def test_no_speed_satisfies_a_rule_that_is_past_saving() -> None:
    assert motion.stop_speed(2.0, 25.0, 4.5, STEP_S) == motion.UNABLE
