"""Withdrawing clearances: where somebody is late, whoever can still stop before the line gives way.

Windows are disjoint when a clearance is given, and a worst case only gets better as long as vehicles track their
profiles. One that slips behind, breaks down, or stands where it may not, keeps ground for longer than it was held. Of
two whose windows have come too near each other the later one is asked to give its clearance back, or, if it cannot
stop any more, the other. Whoever follows it in its lane waits behind it, so those give theirs back, too.

Nothing is freed on the asking: the ground stays reserved until the vehicle says that it has dropped the clearance.
"""

from __future__ import annotations

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.interlock import UNCLEARED, Limits, can_stop
from gameopt_im.core.kinematics import kernel
from gameopt_im.core.parameters import Interlock
from gameopt_im.core.reservations import Book, Stack, held_in
from gameopt_im.core.snapshot import Bools, Floats, Snapshot
from gameopt_im.core.windows import occupancy, overlap

MARGIN_SHARE = 0.5
"""Share of the margin between two windows that has to be left; tracking may use up the rest and make it good again."""


def withdraw(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, interlock: Interlock) -> tuple[str, ...]:
    """Ask back whatever can no longer be driven as it was cleared; the vehicles that are asked from now on."""
    able = can_stop(snapshot, ground)
    row, rows = book.rows_of(snapshot.ids), book.rows
    held, gives = row >= 0, held_in(row, rows.withdrawn)
    if np.count_nonzero(gives):
        for i in (gives & rows.accepted[row] & ~able).nonzero()[0]:
            book.withdraw(snapshot.ids[i], False)  # it kept it, since it could not stop, and drives it to its end
    near = _too_near(book, ground, snapshot.cycle, interlock)
    waits = np.where(held, held_in(row, rows.withdrawn), limits.phase == UNCLEARED)  # at the line
    if not near and not np.count_nonzero(held & (limits.leader >= 0) & waits[limits.leader]):
        return ()
    place = {vehicle: i for i, vehicle in enumerate(snapshot.ids)}
    asked: set[str] = set()
    for first, second in near:
        for vehicle in sorted((first, second), key=lambda each: -book.held[each].crosses(snapshot.cycle)):
            reservation = book.held[vehicle]
            if reservation.withdrawn or (reservation.clearance and able[place[vehicle]]):
                asked.add(vehicle)
                break
    asked |= _stuck(snapshot, place, able, book, limits, waits, asked)
    fresh = sorted(vehicle for vehicle in asked if not book.held[vehicle].withdrawn)
    for vehicle in fresh:
        book.withdraw(vehicle)
    return tuple(fresh)


def _stuck(
    snapshot: Snapshot, place: dict[str, int], able: Bools, book: Book, limits: Limits, waits: Bools, asked: set[str]
) -> set[str]:
    """Cleared vehicles behind one that will wait at the line, and who can wait too, front to back."""
    stuck: set[str] = set()
    for vehicle in sorted(book.held, key=lambda each: float(snapshot.s[place[each]])):
        j = int(limits.leader[place[vehicle]])
        if not book.held[vehicle].clearance or j < 0 or not able[place[vehicle]]:
            continue
        leader = snapshot.ids[j]
        if waits[j] or leader in asked or leader in stuck:
            stuck.add(vehicle)
    return stuck


def _too_near(book: Book, ground: Ground, cycle: int, interlock: Interlock) -> list[tuple[str, str]]:
    """The pairs of vehicles whose windows have come too near each other on some conflict area."""
    margin_s, margin_m = MARGIN_SHARE * interlock.margin_s, MARGIN_SHARE * interlock.margin_m
    near = clashing(book.stack(cycle), ground.windows, margin_s, margin_m)
    if not np.count_nonzero(near):
        return []
    vehicles = book.by_row()
    return [(vehicles[a], vehicles[b]) for a, b in np.argwhere(near)]


@kernel
def clashing(stack: Stack, windows: Floats, margin_s: float, margin_m: float) -> Bools:
    """(R, R): which reservations' windows are nearer to each other than a margin; above the diagonal."""
    count = stack.first.shape[0]
    near = np.zeros((count, count), np.bool_)
    for a in range(count):
        for b in range(a + 1, count):
            mine = windows[stack.movement[a], stack.footprint[a], stack.movement[b], stack.footprint[b]]
            if not mine[1] > -1e8:  # NaN: the two never touch
                continue
            its = windows[stack.movement[b], stack.footprint[b], stack.movement[a], stack.footprint[a]]
            one = occupancy(stack.x[a], stack.late_x[a], stack.first[a], stack.length[a], mine[0], mine[1])
            other = occupancy(stack.x[b], stack.late_x[b], stack.first[b], stack.length[b], its[0], its[1])
            near[a, b] = overlap(one, other, margin_s, margin_m) > 0.0
    return near
