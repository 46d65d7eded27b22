"""How a vehicle drives by its own sensors: the rules of motion, seen from the driver's seat. Pure."""

from __future__ import annotations

from gameopt_vehicles.profile import SpeedProfile
from gameopt_vehicles.road import Observation
from gameopt_wire import motion
from gameopt_wire.intersection import Lane, Movement
from gameopt_wire.messages import STEP_S

GENTLE_ACCEL_MPS2 = 1.5
"""A vehicle on its own accelerates no harder than this."""
EXIT_HEADWAY_S = 1.3
"""Headway at which the simulator's own car-following can take over safely."""


SAME_SPEED_MPS = 1e-6


def within_capabilities(seen: Observation, speed_mps: float, from_mps: float | None = None) -> float:
    """The speed nearest to `speed_mps` that the vehicle can have one step from now, or from being at `from_mps`."""
    v_mps = seen.speed_mps if from_mps is None else from_mps
    lowest = max(0.0, v_mps - seen.max_decel_mps2 * STEP_S)
    highest = min(seen.max_speed_mps, v_mps + seen.max_accel_mps2 * STEP_S)
    return max(lowest, min(speed_mps, highest))  # a vehicle above its limit brakes no harder than it can


def tracking_speed(profile: SpeedProfile, drift_m: float, time_s: float) -> float:
    """The profile's speed one step from `time_s`, a little more or less if the vehicle is `drift_m` behind it."""
    return motion.tracking_speed(profile.speed_mps(time_s + STEP_S), drift_m)


def widest_drift(seen: Observation, profile: SpeedProfile, drift_m: float, time_s: float) -> float:
    """How far off the profile a vehicle that joins it now, `drift_m` behind, will be at most, m.

    Being slower than the profile it falls further behind until it has caught up, and a heavy one takes its time.
    """
    widest_m, speed = abs(drift_m), seen.speed_mps
    while not profile.ended(time_s):
        if abs(drift_m) <= motion.DRIFT_M and abs(speed - profile.speed_mps(time_s)) <= SAME_SPEED_MPS:
            break  # on it, and it was made for this vehicle
        before, speed = speed, within_capabilities(seen, tracking_speed(profile, drift_m, time_s), speed)
        moved_m = profile.covered_m(time_s + STEP_S) - profile.covered_m(time_s)
        drift_m += moved_m - 0.5 * STEP_S * (before + speed)
        widest_m = max(widest_m, abs(drift_m))
        time_s += STEP_S
    return widest_m


def radar_limit(seen: Observation) -> float:
    """Rule 2 against the leader the radar sees; infinite with nobody ahead."""
    if seen.leader_gap_m is None or seen.leader_speed_mps is None:
        return float("inf")
    return motion.follow_speed(
        seen.leader_gap_m - motion.REAR_GAP_M,
        seen.speed_mps,
        seen.max_decel_mps2,
        seen.leader_speed_mps,
        seen.leader_decel_mps2 or seen.max_decel_mps2,
        STEP_S,
    )


def safe_limit(seen: Observation, *, setback_m: float, may_cross: bool) -> float:
    """Rules 1 and 2 from own sensors: what no command may exceed, since the manager may know less than they see.

    Rule 1, its line moved upstream by `setback_m`, binds a vehicle that may not cross and has not yet passed the stop
    line.
    """
    limit = radar_limit(seen)
    if seen.distance_m > 0.0 and not may_cross:
        room_m = seen.distance_m - setback_m
        limit = min(limit, motion.stop_speed(room_m, seen.speed_mps, seen.max_decel_mps2, STEP_S))
    return limit


def can_stop(seen: Observation, setback_m: float) -> bool:
    """Whether rule 1 can still be kept: the vehicle comes to a stand before the line."""
    room_m, slowest = seen.distance_m - setback_m, max(0.0, seen.speed_mps - seen.max_decel_mps2 * STEP_S)
    return motion.stop_speed(room_m, seen.speed_mps, seen.max_decel_mps2, STEP_S) >= slowest


def open_gap_limit(seen: Observation, exit_speed_mps: float) -> float:
    """On the exit lane: fall back to `EXIT_HEADWAY_S` behind the leader, gently."""
    if seen.leader_gap_m is None or seen.leader_gap_m >= EXIT_HEADWAY_S * seen.speed_mps:
        return float("inf")
    slowest = max(seen.speed_mps - motion.OPENING_DECEL_MPS2 * STEP_S, motion.OPENING_FLOOR * exit_speed_mps)
    return max(seen.leader_gap_m / EXIT_HEADWAY_S, slowest)


def own_limit(
    seen: Observation, movement: Movement, lane: Lane, *, setback_m: float, may_cross: bool, turn_speed: bool
) -> float:
    """Largest next speed under rules 1 to 3 and the limits of the lanes, from own sensors alone.

    One that is past the line without a clearance is a hazard to everybody until it has left the junction, so it goes
    on, behind its leader.
    """
    s = seen.distance_m
    limit = safe_limit(seen, setback_m=setback_m, may_cross=may_cross)
    if s <= -movement.length_m:
        return min(limit, movement.exit_speed_mps, open_gap_limit(seen, movement.exit_speed_mps))
    limit = min(limit, lane.speed_limit_mps)
    if turn_speed and movement.turn_speed_mps is not None:
        v, b = seen.speed_mps, seen.max_decel_mps2
        limit = min(limit, motion.turn_speed(s, v, b, STEP_S, movement.turn_speed_mps))
    return limit


def cruise(seen: Observation) -> float:
    """Accelerate gently; the limits do the rest."""
    return seen.speed_mps + min(GENTLE_ACCEL_MPS2, seen.max_accel_mps2) * STEP_S
