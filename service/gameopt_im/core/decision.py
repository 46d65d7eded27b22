"""What a control cycle decides, between its snapshot and its commands: the pure steps, in their order.

`settle` reads from the states what became of earlier offers; `picture` says who may do what; candidates are
planned and solved elsewhere; `conclude` grants clearances and makes every speed safe.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gameopt_im.core import auction, interlock
from gameopt_im.core.conflicts import Ground
from gameopt_im.core.granting import NO_SLOT, Grants, grant, intrusions
from gameopt_im.core.interlock import CLEARED, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.leading import Scene
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book, Reservation, Rows, held_in
from gameopt_im.core.scene import scene_of
from gameopt_im.core.snapshot import NONE, Bools, Floats, Ints, Snapshot
from gameopt_im.core.windows import HORIZON, crossing_time, step_at
from gameopt_im.core.withdrawal import withdraw
from gameopt_im.core.worst_cases import refresh
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S


@dataclass(frozen=True, slots=True)
class Settled:
    """Reservations whose vehicles have taken them, that have lapsed, that have been left, and given back when asked."""

    accepted: tuple[Reservation, ...]
    lapsed: tuple[Reservation, ...]
    left: tuple[Reservation, ...]
    returned: tuple[Reservation, ...]


NOTHING = Settled((), (), (), ())


def settle(book: Book, snapshot: Snapshot, ground: Ground) -> Settled:
    """Bring the book up to date with what the vehicles say.

    An offer lapses when a state from after its expiry does not name it. A vehicle that says nothing keeps its
    ground until it is heard again or given up as lost: it may have taken the offer. An accepted clearance is returned
    by a vehicle that no longer names it and can stop; it lapses where its arrays end, for what its vehicle will do then
    is no longer known: the ground is held anew for whoever stands on it.
    """
    row, held = book.rows_of(snapshot.ids), len(book.held)
    if np.count_nonzero(row >= 0) < held or np.count_nonzero(book.rows.clearance[:held]) < held:
        present = set(snapshot.ids)
        for each in [*book.held.values()]:
            if each.vehicle not in present or not each.clearance:
                book.free(each.vehicle)
    taken, end = _became(
        book.rows_of(snapshot.ids), book.rows, snapshot.cycle, snapshot.time_s, snapshot.accepted, snapshot.heard_s,
        snapshot.age, interlock.can_stop(snapshot, ground), ground.clear, ground.length,
    )  # fmt: skip

    if not (np.count_nonzero(taken) or np.count_nonzero(end)):
        return NOTHING

    def of(mask: Bools) -> tuple[Reservation, ...]:
        return tuple(book.held[snapshot.ids[i]] for i in mask.nonzero()[0])

    settled = Settled(of(taken), of(end == LAPSED), of(end == LEFT), of(end == RETURNED))
    for reservation in settled.accepted:
        book.accept(reservation.vehicle)
    for reservation in settled.lapsed + settled.left + settled.returned:
        book.free(reservation.vehicle)
    return settled


STAYS, LAPSED, LEFT, RETURNED = range(4)
"""What becomes of a reservation."""


@kernel
def _became(
    row: Ints,
    rows: Rows,
    cycle: int,
    time_s: float,
    says: Ints,
    s: Floats,
    age: Floats,
    able: Bools,
    clear: Floats,
    path: Floats,
) -> tuple[Bools, Ints]:
    """(n,) whose offer has been taken, and (n,) what becomes of each one's reservation."""
    n = row.shape[0]
    taken, end = np.zeros(n, np.bool_), np.full(n, STAYS)
    for i in range(n):
        r = row[i]
        if r < 0:
            continue
        taken[i] = not rows.accepted[r] and says[i] == rows.clearance[r]
        accepted = taken[i] or rows.accepted[r]
        m, x = rows.movement[r], -s[i]
        may_drop = rows.withdrawn[r] or able[i]
        if accepted and x - rows.length[r] >= clear[m] and x >= path[m]:
            end[i] = LEFT
        elif accepted and says[i] == NONE and may_drop:
            end[i] = RETURNED
        elif accepted:
            ended = cycle - rows.start[r] >= HORIZON - 2 and age[i] <= 0.0
            end[i] = LAPSED if ended else STAYS
        else:
            expired = time_s - age[i] > rows.expires_s[r] + 1e-6
            end[i] = LAPSED if expired else STAYS
    return taken, end


@dataclass(frozen=True, slots=True)
class Picture:
    """What the interlock allows each vehicle, the scene, who has strayed, and whose clearance is asked back now."""

    limits: Limits
    scene: Scene
    strayed: tuple[str, ...]
    withdrawn: tuple[str, ...]


def picture(snapshot: Snapshot, ground: Ground, book: Book, parameters: Parameters) -> Picture:
    """Who may do what next; ground is held for any vehicle that may be in the zone without a clearance."""
    limits = interlock.limits(snapshot, ground, book, parameters.exit)
    scene = scene_of(snapshot, ground, book, limits, parameters.exit)
    strayed = refresh(snapshot, scene, book)
    for i, intrusion in intrusions(snapshot, limits):
        if intrusion.vehicle not in book.held:
            book.add(intrusion)
            scene.way[i] = book.row[intrusion.vehicle]
    withdrawn = withdraw(snapshot, ground, book, limits, parameters.interlock)
    if withdrawn or np.count_nonzero(scene.asked):
        limits = _held_up(snapshot, ground, book, limits, scene)
    return Picture(limits, scene, strayed, withdrawn)


def _held_up(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, scene: Scene) -> Limits:
    """Rule 1 for those, too, whose clearance is asked back: the speed to drive by once they have dropped it."""
    asked = held_in(book.rows_of(snapshot.ids), book.rows.withdrawn)
    scene.asked[:] = asked
    return replace(limits, stop=interlock.stop_limits(snapshot, ground, asked | (limits.phase == UNCLEARED)))


@dataclass(frozen=True, slots=True)
class Winner:
    """q*: the bidders' rows in crossing order, their slots (s from now) and speeds (m/s).

    `number` is the weight vector it came from, -1 for the incumbent; `delay` its predicted weighted delay, s.
    `asking` (vehicles of the snapshot,) marks who wants a clearance now; None leaves it to `interlock.ask`.
    """

    number: int
    delay: float
    order: Ints
    slots: Floats
    speeds: Floats
    bids: Floats
    asking: Bools | None = None


@dataclass(frozen=True, slots=True)
class Conclusion:
    """Safe speeds (n,) for every vehicle of the snapshot, the crossing order, and what was granted.

    `slots` (n,) in s from the snapshot, NaN where a vehicle has none.
    """

    speeds: Floats
    order: Ints
    slots: Floats
    grants: Grants


def conclude(
    snapshot: Snapshot,
    ground: Ground,
    book: Book,
    picture: Picture,
    who: Bidders,
    winner: Winner | None,
    parameters: Parameters,
    next_clearance: int,
    slotless: bool,
) -> Conclusion:
    """Grant clearances in the winner's order, then bound every planned speed by the interlock.

    `slotless` winners have no slots: a clearance is never asked for ahead of one, and aims at none.
    """
    limits = picture.limits
    planned = np.minimum(snapshot.v_max, snapshot.v + snapshot.a_max * parameters.planner.accel_share * STEP_S)
    slots = np.full(len(snapshot), np.nan)
    order = np.empty(0, dtype=np.int64)
    grants = Grants((), 0)
    if winner is not None and len(who):
        order = who.index[winner.order]
        planned[who.index] = winner.speeds
        slots[who.index] = winner.slots
        asking = interlock.binds(planned, limits) if winner.asking is None else winner.asking
        if not slotless and parameters.interlock.ask == "slot":
            asking |= slots < parameters.interlock.grant_ahead_s
        aims = np.full(len(snapshot), NO_SLOT) if slotless else slots
        grants = grant(snapshot, ground, book, limits, picture.scene, order, aims, asking, parameters, next_clearance)
        _price(snapshot, book, who, winner, grants, parameters)
    row = book.rows_of(snapshot.ids)
    crosses = follow_profiles(row, book.rows, snapshot.cycle, snapshot.s, limits.phase, planned, slots)
    held = (row >= 0).nonzero()[0]
    return Conclusion(
        speeds=interlock.bounded(planned, limits),
        order=np.concatenate((held[crosses[held].argsort(kind="stable")], order[row[order] < 0])),
        slots=slots,
        grants=grants,
    )


@kernel
def follow_profiles(
    row: Ints, rows: Rows, cycle: int, s: Floats, phase: Ints, planned: Floats, slots: Floats
) -> Floats:
    """(n,): when whoever holds ground crosses the line, s from now; NEVER for the others.

    Plans every vehicle with a clearance, taken or offered, onto its profile, and gives it its slot.
    """
    crosses = np.full(row.shape[0], NEVER)
    for i in range(row.shape[0]):
        r = row[i]
        if r < 0:
            continue
        k = step_at(rows.start[r], cycle)
        crosses[i] = crossing_time(rows.x[r], rows.start[r], cycle)
        if rows.clearance[r] == 0:
            continue
        slots[i] = crosses[i]
        if phase[i] == CLEARED or phase[i] == UNCLEARED:
            ahead = rows.v[r, min(k + 1, rows.v.shape[1] - 1)]
            planned[i] = motion.tracking_speed(ahead, rows.x[r, k] + s[i])
    return crosses


def _price(
    snapshot: Snapshot, book: Book, who: Bidders, winner: Winner, grants: Grants, parameters: Parameters
) -> None:
    """Write into the new reservations what the auction charges for them (`eq: utility_template`)."""
    if not grants.given:
        return
    prices = auction.prices_of_order(winner.order, winner.bids, who.group, parameters.auction.slot_value_ratio)
    for reservation in grants.given:
        k = int((who.index == snapshot.ids.index(reservation.vehicle)).argmax())
        book.price(reservation.vehicle, float(prices[k]), float(winner.bids[k]))


def incumbent_order(previous: tuple[str, ...], snapshot: Snapshot, who: Bidders) -> list[int]:
    """The bidders' rows in last cycle's order, newcomers appended in order of their zone entry."""
    index = who.index.tolist()
    row = {snapshot.ids[i]: k for k, i in enumerate(index)}
    known = [row[vehicle] for vehicle in previous if vehicle in row]
    seen = set(known)
    newcomers = sorted((i, k) for k, i in enumerate(index) if k not in seen)
    return known + [k for _, k in newcomers]
