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
from gameopt_im.core.leading import Scene
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book, Reservation, crossing_time
from gameopt_im.core.scene import scene_of
from gameopt_im.core.snapshot import NONE, Bools, Floats, Ints, Snapshot
from gameopt_im.core.windows import HORIZON
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


def settle(book: Book, snapshot: Snapshot, ground: Ground) -> Settled:
    """Bring the book up to date with what the vehicles say.

    An offer lapses when a state from after its expiry does not name it. A vehicle that says nothing keeps its
    ground until it is heard again or given up as lost: it may have taken the offer. An accepted clearance is returned
    by a vehicle that no longer names it and can stop; it lapses where its arrays end, for what its vehicle will do then
    is no longer known: the ground is held anew for whoever stands on it.
    """
    able = interlock.can_stop(snapshot, ground)
    place = {vehicle: i for i, vehicle in enumerate(snapshot.ids)}
    accepted, lapsed, left, returned = [], [], [], []
    for vehicle, reservation in list(book.held.items()):
        i = place.get(vehicle)
        if i is None or reservation.clearance == 0:
            book.free(vehicle)
            continue
        if not reservation.accepted and int(snapshot.accepted[i]) == reservation.clearance:
            book.accept(vehicle)
            accepted.append(reservation)
        x = -float(snapshot.heard_s[i])
        if book.held[vehicle].accepted:
            through = x - reservation.length >= ground.clear[reservation.movement]
            if through and x >= ground.length[reservation.movement]:
                left.append(book.free(vehicle))
            elif int(snapshot.accepted[i]) == NONE and (reservation.withdrawn or able[i]):
                returned.append(book.free(vehicle))
            elif reservation.step(snapshot.cycle) >= HORIZON - 2 and snapshot.age[i] <= 0.0:
                lapsed.append(book.free(vehicle))
        elif snapshot.time_s - float(snapshot.age[i]) > reservation.expires_s + 1e-6:
            lapsed.append(book.free(vehicle))
    return Settled(tuple(accepted), tuple(lapsed), tuple(left), tuple(returned))


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
    return Picture(_held_up(snapshot, ground, book, limits, scene), scene, strayed, withdrawn)


def _held_up(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, scene: Scene) -> Limits:
    """Rule 1 for those, too, whose clearance is asked back: the speed to drive by once they have dropped it."""
    asked = book.asked(snapshot.ids)
    scene.asked[:] = asked
    if not asked.any():
        return limits
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
    crossing = _follow_profiles(snapshot, book, limits, planned, slots)
    held = sorted(crossing, key=crossing.__getitem__)
    waiting = [i for i in order if snapshot.ids[i] not in book.held]
    return Conclusion(
        speeds=interlock.bounded(planned, limits),
        order=np.array([*held, *waiting], dtype=np.int64),
        slots=slots,
        grants=grants,
    )


def _follow_profiles(
    snapshot: Snapshot, book: Book, limits: Limits, planned: Floats, slots: Floats
) -> dict[int, float]:
    """Plan every vehicle with a clearance, taken or offered, onto its profile; when whoever holds ground crosses, s."""
    crossing = {}
    for i, vehicle in enumerate(snapshot.ids):
        reservation = book.held.get(vehicle)
        if reservation is None:
            continue
        crossing[i] = crossing_time(reservation, snapshot.cycle)
        if reservation.clearance == 0:
            continue
        k = reservation.step(snapshot.cycle)
        slots[i] = crossing[i]
        if limits.phase[i] in (CLEARED, UNCLEARED):
            ahead = float(reservation.v[min(k + 1, len(reservation.v) - 1)])
            planned[i] = motion.tracking_speed(ahead, float(reservation.x[k] + snapshot.s[i]))
    return crossing


def _price(
    snapshot: Snapshot, book: Book, who: Bidders, winner: Winner, grants: Grants, parameters: Parameters
) -> None:
    """Write into the new reservations what the auction charges for them (`eq: utility_template`)."""
    if not grants.given:
        return
    prices = auction.prices_of_order(winner.order, winner.bids, who.group, parameters.auction.slot_value_ratio)
    row = {snapshot.ids[i]: k for k, i in enumerate(who.index)}
    for reservation in grants.given:
        k = row[reservation.vehicle]
        book.price(reservation.vehicle, float(prices[k]), float(winner.bids[k]))


def incumbent_order(previous: tuple[str, ...], snapshot: Snapshot, who: Bidders) -> list[int]:
    """The bidders' rows in last cycle's order, newcomers appended in order of their zone entry."""
    row = {snapshot.ids[i]: k for k, i in enumerate(who.index)}
    known = [row[vehicle] for vehicle in previous if vehicle in row]
    seen = set(known)
    newcomers = sorted((int(i), k) for k, i in enumerate(who.index) if k not in seen)
    return known + [k for _, k in newcomers]
