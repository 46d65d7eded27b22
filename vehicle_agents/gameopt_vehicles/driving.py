"""How a vehicle drives by its own sensors: the rules of motion, seen from the driver's seat. Pure."""

from __future__ import annotations

from gameopt_vehicles.road import Observation
from gameopt_wire import motion
from gameopt_wire.intersection import Lane, Movement
from gameopt_wire.messages import STEP_S

GENTLE_ACCEL_MPS2 = 1.5
"""A vehicle on its own accelerates, and opens its gap, no harder than this."""
EXIT_HEADWAY_S = 1.3
"""Headway at which the simulator's own car-following can take over safely."""


def within_capabilities(seen: Observation, speed_mps: float) -> float:
    """The speed nearest to `speed_mps` that the vehicle can have one step from now."""
    lowest = max(0.0, seen.speed_mps - seen.max_decel_mps2 * STEP_S)
    highest = min(seen.max_speed_mps, seen.speed_mps + seen.max_accel_mps2 * STEP_S)
    return max(lowest, min(speed_mps, highest))  # a vehicle above its limit brakes no harder than it can


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


def open_gap_limit(seen: Observation) -> float:
    """On the exit lane: fall back to `EXIT_HEADWAY_S` behind the leader, gently."""
    if seen.leader_gap_m is None or seen.leader_gap_m >= EXIT_HEADWAY_S * seen.speed_mps:
        return float("inf")
    return max(seen.leader_gap_m / EXIT_HEADWAY_S, seen.speed_mps - GENTLE_ACCEL_MPS2 * STEP_S)


def own_limit(
    seen: Observation, movement: Movement, lane: Lane, *, setback_m: float, may_cross: bool, turn_speed: bool
) -> float:
    """Largest next speed under rules 1 to 3 and the limits of the lanes, from own sensors alone.

    Rule 1, its line moved upstream by `setback_m`, binds a vehicle that may not cross and has not yet passed the stop
    line; one that is past it is a hazard to everybody until it has cleared the junction, so it goes on, behind its
    leader.
    """
    s = seen.distance_m
    limit = radar_limit(seen)
    if s > 0.0 and not may_cross:
        limit = min(limit, motion.stop_speed(s - setback_m, seen.speed_mps, seen.max_decel_mps2, STEP_S))
    if s <= -movement.length_m:
        return min(limit, movement.exit_speed_mps, open_gap_limit(seen))
    limit = min(limit, lane.speed_limit_mps)
    if turn_speed and movement.turn_speed_mps is not None:
        v, b = seen.speed_mps, seen.max_decel_mps2
        limit = min(limit, motion.turn_speed(s, v, b, STEP_S, movement.turn_speed_mps))
    return limit


def cruise(seen: Observation) -> float:
    """Accelerate gently; the limits do the rest."""
    return seen.speed_mps + min(GENTLE_ACCEL_MPS2, seen.max_accel_mps2) * STEP_S
