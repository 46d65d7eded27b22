"""What is made of vehicles between their states: where they are predicted to be, and who is dropped. Compiled.

Arrays (n,) by the names of `tracked.Heard`; `reserved` says who has a clearance by the manager's own books.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import NONE, Bools, Floats, Ints
from gameopt_wire.messages import STEP_S
from gameopt_wire.motion import STOP_OFFSET_M, could_stop

STAYS, LEFT, LOST, STALE = range(4)
"""What becomes of a vehicle; see `tracker`."""


class Patience(NamedTuple):
    """Silence after which a vehicle is stale or lost, s; how far its rear is past the conflict zone when its headway
    has been opened, and when it is done with, m."""

    stale_s: float
    hold_s: float
    opened_m: float
    done_m: float


@kernel
def waits(s: float, v: float, b: float, accepted: int, reserved: bool) -> bool:
    """Whether it stops at the line by itself: it could, and has no clearance by the manager's books or its own word."""
    return not reserved and accepted == NONE and could_stop(s, v, b)


@kernel
def predicted(
    time: Floats, s: Floats, v: Floats, b: Floats, setback: Floats, accepted: Ints, reserved: Bools, time_s: float
) -> tuple[Floats, Floats]:
    """Distances to the line and speeds at `time_s`, at constant speed.

    Without a clearance a vehicle that can stop does so by itself (rule 1), so it is predicted no further than
    where it would stand. A state from just after the control cycle's time is taken back, one step at most.
    """
    out_s, out_v = np.empty_like(s), v.copy()
    for i in range(s.shape[0]):
        age = max(time_s - time[i], -STEP_S)
        out_s[i] = s[i] - v[i] * age
        if age > 0.0 and waits(s[i], v[i], b[i], accepted[i], reserved[i]):
            rest = min(s[i], setback[i] + STOP_OFFSET_M)
            out_s[i] = max(out_s[i], rest)
            out_v[i] = min(v[i], math.sqrt(2.0 * b[i] * max(out_s[i] - rest, 0.0)))
    return out_s, out_v


@kernel
def seen(
    time: Floats,
    s: Floats,
    v: Floats,
    b: Floats,
    v_max: Floats,
    setback: Floats,
    entered: Floats,
    accepted: Ints,
    vanished: Ints,
    movement: Ints,
    reserved: Bools,
    limit: Floats,
    exit_limit: Floats,
    time_s: float,
    silent_s: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Bools]:
    """What a snapshot at `time_s` says beside the records, (n,): s, v, v_max, age, waited, heard_s, heard_v, silent.

    `limit` and `exit_limit` (M,) hold before the line and past it. A state older than `silent_s` is silence.
    """
    now_s, now_v = predicted(time, s, v, b, setback, accepted, reserved, time_s)
    age = np.maximum(time_s - time, 0.0)
    heard_s, heard_v = np.where(age > 0.0, s, now_s), np.where(age > 0.0, v, now_v)
    top = np.minimum(v_max, np.where(now_s > 0.0, limit[movement], exit_limit[movement]))
    silent = (age > silent_s) | (vanished > 0)
    return now_s, now_v, top, age, np.maximum(time_s - entered, 0.0), heard_s, heard_v, silent


@kernel
def has_left(rear_m: float, front_m: float, end_m: float, patience: Patience) -> bool:
    """Whether it is through: the rear this far past the conflict zone, and the exit stretch done.

    `front_m` is past the line, where the exit lane ends at `end_m`.
    """
    return rear_m >= 0.0 and (rear_m >= patience.done_m or front_m >= end_m)


@kernel
def fates(
    time: Floats,
    s: Floats,
    v: Floats,
    length: Floats,
    b: Floats,
    movement: Ints,
    accepted: Ints,
    vanished: Ints,
    reserved: Bools,
    clear: Floats,
    end: Floats,
    time_s: float,
    patience: Patience,
) -> Ints:
    """(n,) what becomes of each vehicle; `clear` (M,) is where a rear stands clear, `end` (M,) where the exit ends."""
    out = np.full(s.shape[0], STAYS)
    for i in range(s.shape[0]):
        m, age, front = movement[i], time_s - time[i], -s[i]
        rear, moved = front - length[i] - clear[m], front + v[i] * max(age, 0.0)
        # Heard last where nothing can be in its way any more, or about to leave the map.
        was_clear = rear >= 0.0 or front + 2.0 * STEP_S * v[i] >= end[m]
        # Its silence means that it needs no more commands: its headway has been opened.
        released = age > 1.5 * STEP_S and rear >= patience.opened_m
        through = has_left(moved - length[i] - clear[m], moved, end[m], patience)
        if was_clear and (vanished[i] > 0 or released or through):
            out[i] = LEFT
        elif age > patience.hold_s:
            out[i] = LOST
        elif age > patience.stale_s and waits(s[i], v[i], b[i], accepted[i], reserved[i]):
            out[i] = STALE
    return out
