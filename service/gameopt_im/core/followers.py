"""Those who come after: a new clearance may not hold up anybody who has one already.

Two movements from different lanes may leave by one exit lane. Their windows keep them apart where they merge, and
whoever is second is cleared behind the first. But the first may be cleared after the second, into a gap before it,
and then, if it is slow, rule 2 brakes the second in the conflict zone: it comes later than its ground is held for.
"""

from __future__ import annotations

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.profiles import RULE_TOLERANCE_MPS, follow, time_at
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Floats
from gameopt_wire import motion


def holds_up(book: Book, ground: Ground, made: Reservation, cycle: int) -> bool:
    """Whether somebody cleared already would come later than in its worst case, behind this crossing in its own."""
    exit_lane, own = ground.exit_lane, float(ground.length[made.movement])
    merges = float(time_at(made.x, made.step(cycle), own))
    for held in book.held.values():
        if not held.clearance or held.lane == made.lane or exit_lane[held.movement] != exit_lane[made.movement]:
            continue
        first, path = held.step(cycle), float(ground.length[held.movement])
        if float(time_at(held.x, first, path)) <= merges:
            continue  # it is ahead
        back = made.length + motion.REAR_GAP_M + own - path
        room: Floats = np.where(made.late_x >= own, made.late_x - back, NEVER)
        clear = float(ground.clear[held.movement]) + held.length
        leader = room[None], made.late_v[None], np.array([made.b])
        if not _keeps_behind(held.late_x, held.late_v, held.b, first, clear, *leader):
            return True
    return False


@kernel
def _keeps_behind(
    x: Floats, v: Floats, b: float, first: int, clear: float, lead_room: Floats, lead_v: Floats, lead_b: Floats
) -> bool:
    """Whether rule 2 behind the leaders lets a vehicle keep to (x, v) from step `first` until it is at `clear`."""
    for k in range(first, x.shape[0] - 1):
        if x[k] >= clear:
            return True
        if follow(x[k], v[k], b, k - first, lead_room, lead_v, lead_b)[0] < v[k + 1] - RULE_TOLERANCE_MPS:
            return False
    return True
