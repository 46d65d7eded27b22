"""The stop sign: every vehicle halts at its line, and the first to stand there goes first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.snapshot import Bools, Ints, Snapshot
from gameopt_wire import motion

STANDING_MPS = 0.1
"""Who is no faster than this stands."""
AT_LINE_M = 0.5
"""Who stands no farther than this from where rule 1 stops it stands at its line: it comes within millimetres of it."""


def at_line(snapshot: Snapshot, ground: Ground) -> Bools:
    """Who is heard to stand where it has to wait, 1 m before the line or its setback."""
    setback = ground.setback[snapshot.movement, snapshot.footprint]
    room = snapshot.s - setback - motion.STOP_OFFSET_M
    return np.asarray((room <= AT_LINE_M) & (snapshot.v <= STANDING_MPS) & (snapshot.age <= 0.0))


def queue(previous: Sequence[str], snapshot: Snapshot, uncleared: Bools, standing: Bools) -> tuple[str, ...]:
    """Who has come to a stand at its line and has not been cleared, first come, first served; ties by zone entry.

    Who has stood keeps its turn: the offer it got may lapse, and a step forward is not a second arrival.
    """
    waiting = {vehicle for i, vehicle in enumerate(snapshot.ids) if uncleared[i]}
    known = [vehicle for vehicle in previous if vehicle in waiting]
    seen = set(known)
    return (*known, *(snapshot.ids[i] for i in np.flatnonzero(uncleared & standing) if snapshot.ids[i] not in seen))


def next_to_go(waiting: Ints, snapshot: Snapshot, ground: Ground) -> Ints:
    """Of the queue's indices `waiting` those nobody before them wants the same ground as.

    Without this who came later could go again and again through ground that the first cannot use yet.
    """
    chosen = []
    for turn, i in enumerate(waiting):
        ahead = waiting[:turn]
        other = snapshot.movement[ahead], snapshot.footprint[ahead]
        met = ground.windows[snapshot.movement[i], snapshot.footprint[i]][*other, 0]
        if np.isnan(met).all():
            chosen.append(i)
    return np.array(chosen, dtype=np.int64)
