"""Those who come after: a new clearance may not hold up anybody who has one already.

Two movements from different lanes may leave by one exit lane. Their windows keep them apart where they merge, and
whoever is second is cleared behind the first. But the first may be cleared after the second, into a gap before it,
and then, if it is slow, rule 2 brakes the second in the conflict zone: it comes later than its ground is held for.
"""

from __future__ import annotations

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.leading import Ways, room_of, ways_of
from gameopt_im.core.profiles import RULE_TOLERANCE_MPS, follow
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.snapshot import Floats
from gameopt_im.core.windows import step_at, time_at
from gameopt_wire import motion


def holds_up(book: Book, ground: Ground, made: Reservation, cycle: int) -> bool:
    """Whether somebody cleared already would come later than in its worst case, behind this crossing in its own."""
    exit_lane, own = ground.exit_lane, float(ground.length[made.movement])
    merges = float(time_at(made.x, made.step(cycle), own))
    for vehicle, held in book.held.items():
        if not held.clearance or held.lane == made.lane or exit_lane[held.movement] != exit_lane[made.movement]:
            continue
        path = float(ground.length[held.movement])
        if float(time_at(held.x, held.step(cycle), path)) <= merges:
            continue  # it is ahead
        back = made.length + motion.REAR_GAP_M + own - path
        clear = float(ground.clear[held.movement]) + held.length
        lead = made.late_x, made.late_v, made.b, back, own
        if not _keeps_behind(book.row[vehicle], held.b, clear, *lead, cycle, ways_of(book.rows)):
            return True
    return False


@kernel
def _keeps_behind(
    row: int,
    b: float,
    clear: float,
    lead_x: Floats,
    lead_v: Floats,
    lead_b: float,
    back: float,
    since: float,
    cycle: int,
    ways: Ways,
) -> bool:
    """Whether rule 2 behind a leader leaves a reservation its worst case from now until it is at `clear`.

    The leader counts once its front is at `since`.
    """
    steps = ways.x.shape[1]
    room = room_of(lead_x, lead_v, lead_b, back, since)
    first = step_at(ways.start[row], cycle)
    for k in range(first, steps - 1):
        x, v, wanted = ways.late_x[row, k], ways.late_v[row, k], ways.late_v[row, k + 1]
        if x >= clear:
            return True
        if follow(x, v, b, wanted, k - first, room)[0] < wanted - RULE_TOLERANCE_MPS:
            return False
    return True
