"""The interlock: nothing reaches a vehicle that has not passed here, whatever a solver says.

An uncleared vehicle can always stop before the line (rule 1). Every vehicle can stop behind its leader (rule 2)
and takes a turn at its speed (rule 3). A vehicle passes its point of no return only with a clearance: a complete
profile whose windows on every conflict area are disjoint, by a margin, from every window reserved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.diverging import spans
from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.leaders import exit_leaders, follow_limit, lane_leaders, nearest
from gameopt_im.core.parameters import Exit
from gameopt_im.core.profiles import RULE_TOLERANCE_MPS
from gameopt_im.core.reservations import Book, held_in
from gameopt_im.core.snapshot import FOREIGN, Bools, Floats, Ints, Snapshot
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

UNCLEARED, CLEARED, EXITING, INTRUDING = 0, 1, 2, 3
"""Phases: before its clearance; on it; past the conflict zone; where it may be without a clearance."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What the interlock allows each of n vehicles for the next step, m/s.

    `stop` is rule 1, `follow` rule 2 (with the exit law for exiting vehicles), `turn` rule 3, `top` and `floor` what
    the vehicle can reach, or may have reached since it was last heard; on a clearance the way up is its own to mind.
    `leader` is the index of the next vehicle ahead on its lane, `leaders` (n, R) those of the next on each movement of
    that lane, `downstream` that of the next on its exit lane, -1 for none. `unheard` marks who sees somebody ahead that
    the manager does not know of.
    """

    phase: Ints
    leader: Ints
    leaders: Ints
    downstream: Ints
    unheard: Bools
    stop: Floats
    follow: Floats
    turn: Floats
    top: Floats
    floor: Floats


def phases(snapshot: Snapshot, ground: Ground, book: Book) -> Ints:
    """The phase of each vehicle.

    Phases follow from what was heard, never from a prediction: who could stop then does so unless it has taken a
    clearance, and who was not yet past the conflict zone may still be held up in it. A vehicle on the clearance of a
    manager before this one will cross, whatever it is told: it intrudes from now on.
    """
    accepted = held_in(book.rows_of(snapshot.ids), book.rows.accepted)
    return _phases(
        snapshot.heard_s, snapshot.length, snapshot.accepted, snapshot.movement, accepted, can_stop(snapshot, ground),
        ground.length, ground.clear,
    )  # fmt: skip


@kernel
def _phases(
    s: Floats, length: Floats, says: Ints, movement: Ints, accepted: Bools, able: Bools, path: Floats, clear: Floats
) -> Ints:
    phase = np.empty(s.shape[0], np.int64)
    for i in range(s.shape[0]):
        x = -s[i]
        if x >= path[movement[i]] and x - length[i] >= clear[movement[i]] - 1e-6:
            phase[i] = EXITING
        elif accepted[i]:
            phase[i] = CLEARED
        else:
            phase[i] = UNCLEARED if able[i] and says[i] != FOREIGN else INTRUDING
    return phase


def can_stop(snapshot: Snapshot, ground: Ground) -> Bools:
    """Who could stop before its line by what was heard. Rule 1's tolerance lets a vehicle ride its curve exactly."""
    return np.asarray(
        _can_stop(
            snapshot.heard_s, snapshot.heard_v, snapshot.b_max, ground.setback, snapshot.movement, snapshot.footprint
        )
    )


@kernel
def _can_stop(s: Floats, v: Floats, b: Floats, setbacks: Floats, movement: Ints, footprint: Ints) -> Bools:
    able = np.empty(s.shape[0], np.bool_)
    for i in range(s.shape[0]):
        setback = setbacks[movement[i], footprint[i]]
        room = s[i] - setback - motion.STOP_OFFSET_M + 0.05
        able[i] = 0.5 * v[i] ** 2 / b[i] <= max(room, 0.0) + 1e-6 and s[i] >= setback
    return able


def at_worst(snapshot: Snapshot, ground: Ground, book: Book, phase: Ints, limits: Exit) -> tuple[Floats, Floats]:
    """(x, v) of each vehicle, as far back and as slow as it may be: what a follower has to reckon with.

    Who was heard just now is where it said. One on a clearance is in the worst case of its profile, for which its
    ground is held, unless that is asked back; one past the conflict zone has slowed as the exit law may make it; any
    other has braked fully.
    """
    x, v = -snapshot.s, snapshot.v.copy()
    for i in (snapshot.age > 0.0).nonzero()[0]:
        reservation = book.held.get(snapshot.ids[i])
        heard_x, heard_v, age = -float(snapshot.heard_s[i]), float(snapshot.heard_v[i]), float(snapshot.age[i])
        if phase[i] == CLEARED and reservation is not None and not reservation.withdrawn:
            k = reservation.step(snapshot.cycle)
            x[i], v[i] = max(heard_x, float(reservation.late_x[k])), float(reservation.late_v[k])
        elif phase[i] == EXITING:
            slowest = min(heard_v, motion.OPENING_FLOOR * float(ground.exit_mps[snapshot.movement[i]]))
            x[i], v[i] = _slowed(heard_x, heard_v, max(limits.decel_mps2, motion.OPENING_DECEL_MPS2), slowest, age)
        else:
            x[i], v[i] = _slowed(heard_x, heard_v, float(snapshot.b_max[i]), 0.0, age)
    return x, v


def at_best(snapshot: Snapshot, book: Book, phase: Ints) -> Floats:
    """x of each vehicle, as far ahead as it may be by what was heard: on its profile, if it has a clearance."""
    x = -snapshot.s
    for i in ((snapshot.age > 0.0) & (phase == CLEARED)).nonzero()[0]:
        reservation = book.held[snapshot.ids[i]]
        x[i] = max(x[i], float(reservation.x[reservation.step(snapshot.cycle)]))
    return x


@kernel
def unheard(
    gap: Floats,
    s: Floats,
    v: Floats,
    length: Floats,
    age: Floats,
    leader: Ints,
    downstream: Ints,
    best_x: Floats,
    path: Floats,
) -> Bools:
    """(n,): whose radar sees a vehicle on the approach that may not be the one that the manager takes for its leader.

    The states of that one may all be lost, so it has no clearance, and whoever is behind it cannot cross. In between
    would be at the least a standing gap; a leader may also have moved on since the follower spoke.
    """
    out = np.empty(s.shape[0], np.bool_)
    for i in range(s.shape[0]):
        known = 0.0  # where the rear of the nearest that is known may have been, past the line
        j = leader[i]
        if j >= 0:
            known = min(known, best_x[j] - length[j] - v[j] * age[i])
        j = downstream[i]
        if j >= 0:
            known = min(known, best_x[j] - length[j] - path[j] + path[i] - v[j] * age[i])
        out[i] = gap[i] - s[i] + motion.REAR_GAP_M < known
    return out


def _slowed(x: float, v: float, b: float, slowest: float, time: float) -> tuple[float, float]:
    """(x, v) after braking at b for `time` s, down to `slowest`."""
    braking = min(time, (v - slowest) / b)
    end = v - b * braking
    return x + 0.5 * (v + end) * braking + end * (time - braking), end


NEAR_EXIT_M = -30.0
"""Who is farther from its exit lane than this has not to mind yet who is on it, m."""
OPENING_TIME_S = 8.0
"""A missing metre of headway is opened over this long, s."""


@kernel
def exit_law(
    v: Floats,
    a: Floats,
    length: Floats,
    age: Floats,
    leader: Ints,
    along: Floats,
    headway_s: float,
    decel: float,
    exit_mps: Floats,
) -> Floats:
    """Speed that opens the headway to the leader on the exit, m/s: gently, and never to a crawl by itself."""
    out = np.full(v.shape[0], NEVER)
    for i in range(v.shape[0]):
        j = leader[i]
        if j >= 0:
            gap = along[j] - length[j] - along[i] - motion.REAR_GAP_M
            opening = v[j] + (gap - headway_s * v[i]) / OPENING_TIME_S
            slowest = v[i] + a[i] * age[i] - decel * STEP_S
            out[i] = max(opening, slowest, motion.OPENING_FLOOR * exit_mps[i])
    return out


def limits(snapshot: Snapshot, ground: Ground, book: Book, exit_parameters: Exit) -> Limits:
    """What each vehicle may do next, by rules 1, 2 and 3."""
    phase = phases(snapshot, ground, book)
    worst_x, worst_v = at_worst(snapshot, ground, book, phase, exit_parameters)
    found = _limits(
        phase, snapshot.s, snapshot.v, snapshot.length, snapshot.a_max, snapshot.b_max, snapshot.v_max, snapshot.age,
        snapshot.gap, snapshot.heard_s, snapshot.movement, snapshot.footprint, snapshot.lane,
        worst_x, worst_v, at_best(snapshot, book, phase), ground.length, ground.tail, ground.turns_back, ground.setback,
        ground.turn_mps, ground.exit_lane, ground.exit_mps, ground.apart, ground.rank,
        exit_parameters.headway_s, exit_parameters.decel_mps2,
    )  # fmt: skip
    return Limits(phase, *found)


@kernel
def _limits(
    phase: Ints,
    s: Floats,
    v: Floats,
    length: Floats,
    a: Floats,
    b: Floats,
    v_max: Floats,
    age: Floats,
    gap: Floats,
    heard_s: Floats,
    movement: Ints,
    footprint: Ints,
    lane: Ints,
    worst_x: Floats,
    worst_v: Floats,
    best_x: Floats,
    paths: Floats,
    tails: Floats,
    turns_back: Bools,
    setbacks: Floats,
    turns: Floats,
    exit_lane: Ints,
    exits: Floats,
    apart: Floats,
    rank: Ints,
    headway_s: float,
    decel: float,
) -> tuple[Ints, Ints, Ints, Bools, Floats, Floats, Floats, Floats, Floats]:
    """The fields of `Limits` after the phase: arrays (n,) of the snapshot, then those of the ground."""
    n, path, exit_mps = s.shape[0], paths[movement], exits[movement]
    tail, room = np.empty(n), np.empty(n)
    for i in range(n):
        tail[i], room[i] = tails[movement[i], footprint[i]], s[i] - setbacks[movement[i], footprint[i]]
    x, along, exiting = -s, -s - path, phase == EXITING
    span = spans(length, path, turns_back[movement], tail)
    leaders = lane_leaders(lane, movement, x, worst_x, span, apart, rank)
    leader, downstream = nearest(leaders, worst_x), exit_leaders(exit_lane[movement], along, worst_x - path)
    near = np.where(along >= NEAR_EXIT_M, downstream, -1)
    follow = follow_limit(x, v, length, b, worst_x, worst_v, near, -path)
    for r in range(leaders.shape[1]):
        column, nothing = leaders[:, r].copy(), np.zeros(n)
        follow = np.minimum(follow, follow_limit(x, v, span, b, worst_x, worst_v, column, nothing))
    opening = exit_law(v, a, length, age, np.where(exiting, downstream, -1), along, headway_s, decel, exit_mps)
    reach = np.minimum(v_max, v + a * (STEP_S + age))
    return (
        leader, leaders, downstream, unheard(gap, heard_s, v, length, age, leader, downstream, best_x, path),
        _stop_speeds(phase == UNCLEARED, room, v, b), np.minimum(follow, opening),
        _turn_speeds((x < path) & ~exiting, s, v, b, turns[movement]), np.where(phase == CLEARED, v_max, reach),
        np.maximum(0.0, v - b * (STEP_S + age)),
    )  # fmt: skip


def stop_limits(snapshot: Snapshot, ground: Ground, bound: Bools) -> Floats:
    """Rule 1 for whom it binds, m/s; NEVER for the others."""
    room = snapshot.s - ground.setback[snapshot.movement, snapshot.footprint]
    return _stop_speeds(bound, room, snapshot.v, snapshot.b_max)


@kernel
def _stop_speeds(bound: Bools, room: Floats, v: Floats, b: Floats) -> Floats:
    out = np.full(room.shape[0], NEVER)
    for i in range(room.shape[0]):
        if bound[i]:
            out[i] = motion.stop_speed(room[i], v[i], b[i], STEP_S)
    return out


@kernel
def _turn_speeds(inside: Bools, s: Floats, v: Floats, b: Floats, turn: Floats) -> Floats:
    """Rule 3 up to the end of the conflict zone, m/s; NEVER where no turning speed holds."""
    out = np.full(s.shape[0], NEVER)
    for i in range(s.shape[0]):
        if inside[i] and turn[i] < NEVER:
            out[i] = motion.turn_speed(s[i], v[i], b[i], STEP_S, turn[i])
    return out


def bounded(speed: Floats, limits_: Limits) -> Floats:
    """The planned speeds made safe: never above a rule, never beyond what the vehicle can reach."""
    safe = np.minimum(np.minimum(limits_.stop, limits_.follow), np.minimum(limits_.turn, limits_.top))
    return np.maximum(np.minimum(speed, safe), limits_.floor)


def binds(speed: Floats, limits_: Limits) -> Bools:
    """Where rule 1 would slow a vehicle below its planned speed: the moment to ask for a clearance."""
    return np.minimum(speed, limits_.follow) > limits_.stop - RULE_TOLERANCE_MPS
