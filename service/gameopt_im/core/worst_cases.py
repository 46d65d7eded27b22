"""Bringing worst cases up to date, every control cycle, from where the vehicles really are."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.leading import Scene, ahead_of, room_behind, ways_of
from gameopt_im.core.profiles import held_back
from gameopt_im.core.reservations import Book, Rows, held_in
from gameopt_im.core.scene import law_of
from gameopt_im.core.snapshot import Bools, Ints, Snapshot

OFF_PROFILE_M = 0.4
"""A vehicle farther than this outside its profile and worst case has strayed: its windows may no longer hold."""


def refresh(snapshot: Snapshot, scene: Scene, book: Book) -> tuple[str, ...]:
    """Bring the worst cases up to date, front to back; the vehicles that have strayed.

    What leaders might have done since, they have not, so the worst case of a vehicle that tracks its profile only gets
    better. One has strayed if it is ahead of its profile or behind the worst case it was reserved for. A state that
    came late says as much, of the control cycle it is from: waiting for a fresh one would be for ever on a slow link.
    """
    row = book.rows_of(snapshot.ids)
    cleared = held_in(row, book.rows.clearance > 0).nonzero()[0]
    order = cleared[snapshot.s[cleared].argsort(kind="stable")]
    strayed = bring_up_to_date(order, scene, book.rows)
    return tuple(snapshot.ids[i] for i in order[strayed])


@kernel
def bring_up_to_date(order: Ints, scene: Scene, rows: Rows) -> Bools:
    """New worst cases, in place, of the vehicles in `order`; which of them have strayed."""
    steps, ways = rows.x.shape[1], ways_of(rows)
    strayed = np.zeros(order.shape[0], np.bool_)
    for n in range(order.shape[0]):
        i = order[n]
        row = scene.way[i]
        then = scene.cycle - scene.ago[i]
        k = then - rows.start[row]
        if then <= rows.told[row] or scene.exiting[i] or not 0 <= k < steps - 2:
            continue
        rows.told[row] = then
        x = scene.heard_x[i]
        strayed[n] = not rows.late_x[row, k] - OFF_PROFILE_M <= x <= rows.x[row, k] + OFF_PROFILE_M
        room = room_behind(ahead_of(i, scene), True, scene.cycle, scene.ago[i], ways)
        held_back(
            x, scene.heard_v[i], rows.v[row], k, (rows.length[row], scene.a[i], rows.b[row]), scene.clear[i],
            law_of(i, scene), room, rows.late_x[row], rows.late_v[row],
        )  # fmt: skip
    return strayed
