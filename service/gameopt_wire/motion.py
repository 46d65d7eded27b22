"""The rules of motion that both sides obey: the interlock on every command, a vehicle on its own fallback.

All are exact for a ballistic step: the speed goes linearly from v to u within dt, so the way is dt (v + u) / 2
(`eq:eq_cons_3_1`). Each rule gives the largest u after which the vehicle can still do what the rule asks with
its full deceleration; a negative result means that even braking fully is too late.
Scalars in SI units; plain arithmetic, so the manager compiles these very functions.
"""

from __future__ import annotations

import math

STOP_OFFSET_M = 1.0
"""An uncleared vehicle can always stop this far before the stop line."""
REAR_GAP_M = 2.0
"""Standing distance between bumpers, the paper's M_sr."""
TURN_DECEL_MPS2 = 3.0
"""A vehicle slows for a turn at this or its own deceleration, whichever is less."""
OPENING_DECEL_MPS2 = 1.5
OPENING_FLOOR = 0.75
"""Opening its headway on the exit lane a vehicle on its own brakes no harder, and nobody gets slower by it than this
share of the limit: a platoon must not stop itself, car by car, back into the conflict zone."""
DRIFT_M = 0.05
DRIFT_GAIN_HZ = 0.5
DRIFT_SPEED_MPS = 0.3
"""Tracking a profile: a drift beyond `DRIFT_M` is corrected at `DRIFT_GAIN_HZ`, by `DRIFT_SPEED_MPS` at most."""
UNABLE = -1.0
"""What a rule answers where no speed satisfies it."""


def most_squared(room_m: float, v_mps: float, b_mps2: float, dt_s: float) -> float:
    """(u + b dt / 2)^2 for the largest u after which it can stop within `room_m`; negative where there is none."""
    half = 0.5 * b_mps2 * dt_s
    return half * half + 2.0 * b_mps2 * (room_m - 0.5 * v_mps * dt_s)


def brake_speed(room_m: float, v_mps: float, b_mps2: float, dt_s: float, end_mps: float) -> float:
    """Largest u after which `end_mps` is reached within `room_m` when braking at b from then on.

    From dt (v + u)/2 + (u^2 - end^2)/(2 b) <= room.
    """
    under = most_squared(room_m, v_mps, b_mps2, dt_s) + end_mps * end_mps
    if under < 0.0:
        return UNABLE
    return math.sqrt(under) - 0.5 * b_mps2 * dt_s


def may_drive(u_mps: float, room_m: float, v_mps: float, b_mps2: float, dt_s: float) -> bool:
    """Whether u is surely no more than `brake_speed` to a stand: most often it is, and nobody needs the root.

    By less than a part in 10^9 it is not sure.
    """
    wanted = u_mps + 0.5 * b_mps2 * dt_s
    return wanted >= 0.0 and most_squared(room_m, v_mps, b_mps2, dt_s) >= wanted * wanted * (1.0 + 1e-9)


def reach(v_mps: float, b_mps2: float, dt_s: float) -> float:
    """How far a vehicle goes that brakes fully from now on, m: dt (v + v_l)/2 + v_l^2/(2 b), v_l = max(0, v - b dt)."""
    after = max(0.0, v_mps - b_mps2 * dt_s)
    return 0.5 * dt_s * (v_mps + after) + after * after / (2.0 * b_mps2)


def stop_speed(s_m: float, v_mps: float, b_mps2: float, dt_s: float) -> float:
    """Rule 1: an uncleared vehicle can stop `STOP_OFFSET_M` before the line."""
    return brake_speed(s_m - STOP_OFFSET_M, v_mps, b_mps2, dt_s, 0.0)


def could_stop(s_m: float, v_mps: float, b_mps2: float) -> bool:
    """Whether a vehicle that far before the line could come to a stand there; one that rides rule 1's curve could."""
    return v_mps * v_mps <= 2.0 * b_mps2 * s_m


def turn_speed(s_m: float, v_mps: float, b_mps2: float, dt_s: float, turn_mps: float) -> float:
    """Rule 3: the turning speed is reached by the stop line, and held beyond it."""
    if s_m <= 0.0:
        return turn_mps
    return max(turn_mps, brake_speed(s_m, v_mps, min(TURN_DECEL_MPS2, b_mps2), dt_s, turn_mps))


def follow_speed(
    gap_m: float, v_mps: float, b_mps2: float, lead_v_mps: float, lead_b_mps2: float, dt_s: float
) -> float:
    """Rule 2: the follower can stop behind its leader even if the leader brakes fully from now on.

    `gap_m` is bumper to bumper less `REAR_GAP_M`. With b* = min(b_y, b_x) (max would be unsafe),
    R = gap - v dt/2 + the leader's `reach`.
    """
    b = min(b_mps2, lead_b_mps2)
    return brake_speed(gap_m + reach(lead_v_mps, lead_b_mps2, dt_s), v_mps, b, dt_s, 0.0)


def tracking_speed(profile_mps: float, drift_m: float) -> float:
    """The next speed on a profile that asks for `profile_mps`: a little more if the vehicle is `drift_m` behind it."""
    if abs(drift_m) <= DRIFT_M:
        return profile_mps
    return profile_mps + max(-DRIFT_SPEED_MPS, min(DRIFT_SPEED_MPS, DRIFT_GAIN_HZ * drift_m))
