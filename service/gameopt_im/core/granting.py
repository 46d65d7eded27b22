"""Granting clearances: simulate the whole crossing, compare its windows with every reservation, reserve or refuse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.followers import holds_up
from gameopt_im.core.interlock import INTRUDING, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, manner_of
from gameopt_im.core.leading import Room, Scene, Ways, ahead_of, room_behind, ways_of
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.profiles import drive, held_back
from gameopt_im.core.reservations import Book, Reservation, Stack, clash
from gameopt_im.core.scene import law_of
from gameopt_im.core.snapshot import Bools, Floats, Ints, Snapshot
from gameopt_im.core.windows import HORIZON, clear_time
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
    for i in order:
        vehicle = snapshot.ids[i]
        if limits.phase[i] != UNCLEARED or not asking[i] or vehicle in book.held or snapshot.silent[i]:
            continue
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
    interlock = parameters.interlock
    movement, footprint = int(snapshot.movement[i]), int(snapshot.footprint[i])
    target, ahead = slot, ahead_of(i, scene)
    nominal = room_behind(ahead, False, scene.cycle, 0, HORIZON, ways)
    worst = room_behind(ahead, True, scene.cycle, 0, HORIZON, ways)
    for _ in range(interlock.retries + 1):
        driven = _driven(snapshot, ground, scene, nominal, worst, i, target, parameters)
        if driven is None:
            return None
        x, v, late_x, late_v, done = driven
        later = clash(
            x, late_x, float(snapshot.length[i]), movement, footprint,
            stack.x, stack.late_x, stack.first, stack.movement, stack.footprint, stack.length,
            ground.windows, interlock.margin_s, interlock.margin_m,
        )  # fmt: skip
        if later <= 0.0:
            return Reservation(
                vehicle=snapshot.ids[i], clearance=0, start=snapshot.cycle, movement=movement,
                footprint=footprint, lane=int(snapshot.lane[i]), length=float(snapshot.length[i]),
                b=float(snapshot.b_max[i]), x=x, v=v, late_x=late_x, late_v=late_v, done=done,
                start_s=snapshot.time_s, expires_s=snapshot.time_s + interlock.offer_valid_s,
            )  # fmt: skip
        if slot == NO_SLOT or later >= NEVER / 2:
            return None
        target = max(target, clear_time(x, 0.0)) + later + 0.01
        if target > HORIZON * STEP_S / 2:
            return None
    return None


def _driven(
    snapshot: Snapshot,
    ground: Ground,
    scene: Scene,
    nominal: Room,
    worst: Room,
    i: int,
    slot: float,
    parameters: Parameters,
) -> tuple[Floats, Floats, Floats, Floats, int] | None:
    """(x, v, worst-case x, worst-case v, step clear in the worst case) of one crossing; None if it cannot be driven.

    `nominal` and `worst` are the room behind its leaders.
    """
    movement = int(snapshot.movement[i])
    planner = parameters.planner
    turn = min(float(ground.turn_mps[movement]), NEVER)
    top = float(snapshot.v_max[i])
    body = (
        float(snapshot.length[i]),
        float(snapshot.a_max[i]) * planner.accel_share,
        float(snapshot.b_max[i]),
        top,
        float(min(top, ground.exit_mps[movement])),
    )
    way = (
        turn,
        float(ground.length[movement]),
        float(ground.clear[movement]),
        min(turn, top),
        1.0 if slot == NO_SLOT else 0.0,
    )
    x, v, late_x, late_v = (np.empty(HORIZON) for _ in range(4))
    done = drive(-float(snapshot.s[i]), float(snapshot.v[i]), slot, body, way, manner_of(planner), nominal, x, v)
    if done < 0:
        return None
    late = held_back(
        x[0], v[0], v, 0, (body[0], body[1], body[2]), way[2], law_of(i, scene),
        worst, late_x, late_v,
    )  # fmt: skip
    if late < 0:
        return None
    return x, v, late_x, late_v, max(late, done)


def intrusions(snapshot: Snapshot, limits: Limits) -> list[tuple[int, Reservation]]:
    """Reservations for vehicles that may be in the conflict zone without a clearance, with their indices.

    They hold the ground from the earliest they could be on it to the latest: full ahead, or at a crawl.
    """
    made = []
    for i in np.flatnonzero(limits.phase == INTRUDING):
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
