"""Granting clearances: simulate the whole crossing, compare its windows with every reservation, reserve or refuse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.followers import holds_up
from gameopt_im.core.interlock import INTRUDING, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, Manner, kernel, manner_of
from gameopt_im.core.leading import Scene, Ways, ahead_of, room_behind, ways_of
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.profiles import drive, held_back
from gameopt_im.core.reservations import Book, Reservation, Stack, clash
from gameopt_im.core.scene import law_of
from gameopt_im.core.snapshot import Bools, Floats, Ints, Snapshot
from gameopt_im.core.windows import HORIZON, time_at
from gameopt_wire.messages import STEP_S

NO_SLOT = -1.0
"""In place of a slot: full ahead, as the paper's profile asks for a clearance."""


@dataclass(frozen=True, slots=True)
class Grants:
    """What a round of granting did: the new reservations, and how many asked in vain."""

    given: tuple[Reservation, ...]
    refused: int


def grant(
    snapshot: Snapshot,
    ground: Ground,
    book: Book,
    limits: Limits,
    scene: Scene,
    order: Ints,
    slots: Floats,
    asking: Bools,
    parameters: Parameters,
    next_clearance: int,
) -> Grants:
    """Go through the crossing order and clear whoever asks and fits; the book is extended.

    `slots` (n,) in s from the snapshot, NO_SLOT for full ahead; `asking` (n,) marks who wants a clearance now.
    """
    given: list[Reservation] = []
    refused = 0
    stack = book.stack(snapshot.cycle)
    may = (limits.phase == UNCLEARED) & asking & ~snapshot.silent & (book.rows_of(snapshot.ids) < 0)
    for i in order[may[order]].tolist():
        vehicle = snapshot.ids[i]
        if limits.unheard[i] or not _leader_cleared(snapshot, book, limits, i):
            continue
        made = crossing(snapshot, ground, stack, scene, ways_of(book.rows), i, float(slots[i]), parameters)
        if made is None or holds_up(book, ground, made, snapshot.cycle):
            refused += 1
            continue
        reservation = replace(made, clearance=next_clearance + len(given))
        book.add(reservation)
        scene.way[i] = book.row[vehicle]
        given.append(reservation)
        stack = book.stack(snapshot.cycle)
    return Grants(tuple(given), refused)


def _leader_cleared(snapshot: Snapshot, book: Book, limits: Limits, i: int) -> bool:
    """Whether the next vehicle ahead in the lane has taken its clearance, and may keep it, or has passed."""
    j = int(limits.leader[i])
    if j < 0:
        return True
    if limits.phase[j] == UNCLEARED:
        return False
    reservation = book.held.get(snapshot.ids[j])
    return reservation is None or (reservation.accepted and not reservation.withdrawn)


def crossing(
    snapshot: Snapshot,
    ground: Ground,
    stack: Stack,
    scene: Scene,
    ways: Ways,
    i: int,
    slot: float,
    parameters: Parameters,
) -> Reservation | None:
    """A crossing of vehicle i that is disjoint from every reservation, aimed at its slot or later; None if none is."""
    interlock, planner = parameters.interlock, parameters.planner
    movement, footprint = int(snapshot.movement[i]), int(snapshot.footprint[i])
    turn, top = min(float(ground.turn_mps[movement]), NEVER), float(snapshot.v_max[i])
    length, b = float(snapshot.length[i]), float(snapshot.b_max[i])
    exit_top = float(min(top, ground.exit_mps[movement]))
    body = length, float(snapshot.a_max[i]) * planner.accel_share, b, top, exit_top
    slotless = 1.0 if slot == NO_SLOT else 0.0
    way = turn, float(ground.length[movement]), float(ground.clear[movement]), min(turn, top), slotless
    x, v, late_x, late_v = np.empty((4, HORIZON))
    done = cross(
        i, slot, footprint, body, way, manner_of(planner), scene, ways, stack, ground.windows,
        interlock.margin_s, interlock.margin_m, interlock.retries, x, v, late_x, late_v,
    )  # fmt: skip
    if done < 0:
        return None
    return Reservation(
        vehicle=snapshot.ids[i], clearance=0, start=snapshot.cycle, movement=movement, footprint=footprint,
        lane=int(snapshot.lane[i]), length=length, b=b, x=x, v=v, late_x=late_x, late_v=late_v, done=done,
        start_s=snapshot.time_s, expires_s=snapshot.time_s + interlock.offer_valid_s,
    )  # fmt: skip


@kernel
def cross(
    i: int,
    slot: float,
    footprint: int,
    body: tuple[float, float, float, float, float],
    way: tuple[float, float, float, float, float],
    manner: Manner,
    scene: Scene,
    ways: Ways,
    stack: Stack,
    windows: Floats,
    margin_s: float,
    margin_m: float,
    retries: int,
    x: Floats,
    v: Floats,
    late_x: Floats,
    late_v: Floats,
) -> int:
    """Drive vehicle i over the zone at its slot, or at the first later one that clashes with no reservation.

    Fills in the profile and its worst case; the step at which the rear is clear in the worst case, -1 for no crossing.
    `body` and `way` as in `profiles.drive`.
    """
    ahead, target = ahead_of(i, scene), slot
    nominal = room_behind(ahead, False, scene.cycle, 0, ways)
    worst = room_behind(ahead, True, scene.cycle, 0, ways)
    for _ in range(retries + 1):
        done = drive(scene.x[i], scene.v[i], target, body, way, manner, nominal, x, v)
        if done < 0:
            return -1
        late = held_back(
            x[0], v[0], v, 0, (body[0], body[1], body[2]), way[2], law_of(i, scene), worst, late_x, late_v
        )  # fmt: skip
        if late < 0:
            return -1
        later = clash(
            x, late_x, body[0], scene.movement[i], footprint, stack.x, stack.late_x, stack.first, stack.movement,
            stack.footprint, stack.length, windows, margin_s, margin_m,
        )  # fmt: skip
        if later <= 0.0:
            return max(late, done)
        if slot == NO_SLOT or later >= NEVER / 2:
            return -1
        target = max(target, time_at(x, 0, 0.0)) + later + 0.01
        if target > HORIZON * STEP_S / 2:
            return -1
    return -1


def intrusions(snapshot: Snapshot, limits: Limits) -> list[tuple[int, Reservation]]:
    """Reservations for vehicles that may be in the conflict zone without a clearance, with their indices.

    They hold the ground from the earliest they could be on it to the latest: full ahead, or at a crawl.
    """
    made = []
    for i in (limits.phase == INTRUDING).nonzero()[0]:
        x0, v0 = -float(snapshot.s[i]), float(snapshot.v[i])
        times: Floats = np.arange(HORIZON, dtype=np.float64) * STEP_S
        fast: Floats = x0 + np.minimum(v0 + snapshot.a_max[i] * times, max(v0, snapshot.v_max[i])) * times
        slow: Floats = x0 + INTRUDER_MPS * times
        intrusion = Reservation(
            vehicle=snapshot.ids[i],
            clearance=0,
            start=snapshot.cycle,
            movement=int(snapshot.movement[i]),
            footprint=int(snapshot.footprint[i]),
            lane=int(snapshot.lane[i]),
            length=float(snapshot.length[i]),
            b=float(snapshot.b_max[i]),
            x=fast,
            v=np.full(HORIZON, v0),
            late_x=slow,
            late_v=np.full(HORIZON, INTRUDER_MPS),
            done=HORIZON - 1,
            start_s=snapshot.time_s,
            expires_s=snapshot.time_s,
            accepted=True,
        )
        made.append((int(i), intrusion))
    return made


INTRUDER_MPS = 2.0
"""A vehicle in the zone without a clearance may be this slow, m/s; reserved anew every control cycle."""
