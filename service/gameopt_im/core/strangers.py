"""Strangers: vehicles that nobody manages, or that only share the way to the approach, as a vehicle's radar sees them.

Nothing is known of what they will do, so a vehicle behind one is cleared only if it comes through even if the
stranger brakes to a stand from now on. That keeps a queue of strangers on an exit from reaching back into the
conflict zone.
"""

from __future__ import annotations

from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.profiles import resting
from gameopt_im.core.snapshot import Floats, Snapshot
from gameopt_wire import motion

Rows = tuple[Floats, Floats, Floats, Floats, float]


def stranger_rows(snapshot: Snapshot, i: int) -> Rows | None:
    """(room, v, worst-case room, worst-case v, b) behind the stranger ahead of vehicle i; None without one.

    Nominally it goes on at its speed, in the worst case it brakes fully.
    """
    rear = float(snapshot.stranger_x[i])
    if rear >= NEVER:
        return None
    speed, b = float(snapshot.stranger_v[i]), float(snapshot.stranger_b[i])
    x, v = resting(rear - motion.REAR_GAP_M, speed, b, brake=False)
    late_x, late_v = resting(rear - motion.REAR_GAP_M, speed, b, brake=True)
    return x, v, late_x, late_v, b
