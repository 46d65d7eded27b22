"""Granting clearances: simulate the whole crossing, compare its windows with every reservation, reserve or refuse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.diverging import spans
from gameopt_im.core.followers import holds_up
from gameopt_im.core.interlock import EXITING, INTRUDING, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, manner_of
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.profiles import HORIZON, clear_time, drive, held_back, resting
from gameopt_im.core.reservations import Book, Reservation, Stack, clash
from gameopt_im.core.snapshot import Bools, Floats, Ints, Snapshot
from gameopt_im.core.strangers import Rows, stranger_rows
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

NO_SLOT = -1.0
"""In place of a slot: full ahead, as the paper's profile asks for a clearance."""


@dataclass(frozen=True, slots=True)
class Leaders:
    """Leaders of one crossing as arrays for `drive`, in the follower's coordinates; nominal and worst case."""

    room: Floats
    v: Floats
    late_room: Floats
    late_v: Floats
    b: Floats


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
    exits = exit_ways(snapshot, ground, limits, parameters) if asking.any() else {}
    stack = book.stack(snapshot.cycle)
    for i in order:
        vehicle = snapshot.ids[i]
        if limits.phase[i] != UNCLEARED or not asking[i] or vehicle in book.held or snapshot.silent[i]:
            continue
        if limits.unheard[i] or not _leader_cleared(snapshot, book, limits, i):
            continue
        leaders = leaders_of(snapshot, ground, book, limits, exits, i)
        made = crossing(snapshot, ground, stack, leaders, i, float(slots[i]), parameters)
        if made is None or holds_up(book, ground, made, snapshot.cycle):
            refused += 1
            continue
        reservation = replace(made, clearance=next_clearance + len(given))
        book.add(reservation)
        given.append(reservation)
        stack = book.stack(snapshot.cycle)
    return Grants(tuple(given), refused)


def _leader_cleared(snapshot: Snapshot, book: Book, limits: Limits, i: int) -> bool:
    """Whether the next vehicle ahead in the lane has taken its clearance, or has passed."""
    j = int(limits.leader[i])
    if j < 0:
        return True
    if limits.phase[j] == UNCLEARED:
        return False
    reservation = book.held.get(snapshot.ids[j])
    return reservation is None or reservation.accepted


@dataclass(frozen=True, slots=True)
class Way:
    """Where a vehicle without a profile is taken to go, nominal and worst case, from now; (HORIZON,) each."""

    x: Floats
    v: Floats
    late_x: Floats
    late_v: Floats


Ways = dict[int, Way]


def exit_ways(snapshot: Snapshot, ground: Ground, limits: Limits, parameters: Parameters) -> Ways:
    """The ways of all exiting vehicles, by index, front to back along each exit lane.

    Nominally they go on. They are commanded from here, so in the worst case they brake as rule 2 and the exit law
    make them, the first of them for a vehicle that may stand just out of sight.
    """
    along = -snapshot.s - ground.length[snapshot.movement]
    ways: Ways = {}
    for i in sorted(np.flatnonzero(limits.phase == EXITING), key=lambda i: -along[i]):
        x0, v0, b = -float(snapshot.s[i]), float(snapshot.v[i]), float(snapshot.b_max[i])
        x, v = resting(x0, v0, b, brake=False)
        j = int(limits.downstream[i])
        room, lead_v, lead_b = _FAR, _FAR, np.ones(1)
        if j in ways:
            shift = float(ground.length[snapshot.movement[i]] - ground.length[snapshot.movement[j]])
            back = float(snapshot.length[j]) + motion.REAR_GAP_M - shift
            room, lead_v, lead_b = (
                ways[j].late_x[None] - back,
                ways[j].late_v[None],
                snapshot.b_max[j : j + 1],
            )
        elif (ahead := stranger_rows(snapshot, int(i))) is not None:
            room, lead_v, lead_b = ahead[2][None], ahead[3][None], np.array([ahead[4]])
        late_x, late_v = np.empty(HORIZON), np.empty(HORIZON)
        held_back(
            x0, v0, v, 0, (float(snapshot.length[i]), float(snapshot.a_max[i]), b), -NEVER,
            _ahead(ground, int(snapshot.movement[i]), parameters), room, lead_v, lead_b, late_x, late_v,
        )  # fmt: skip
        ways[int(i)] = Way(x, v, late_x, late_v)
    return ways


def leaders_of(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, exits: Ways, i: int) -> Leaders:
    """The vehicles that i has to stay behind: its lane leader, whoever else is bound for its exit lane, and a stranger.

    A leader with a reservation follows its profile, an exiting one its way; any other is taken to go on, or, in
    the worst case, to brake fully from now.
    """
    own = float(ground.length[snapshot.movement[i]])
    bound = ground.exit_lane[snapshot.movement]
    merging = (snapshot.lane != snapshot.lane[i]) & (bound == bound[i]) & (limits.phase != UNCLEARED)
    found = [
        _leader_rows(
            snapshot,
            book,
            exits,
            int(j),
            float(snapshot.length[j]),
            own - float(ground.length[snapshot.movement[j]]),
            own,
            None,
        )
        for j in np.flatnonzero(merging)
    ]
    if (ahead := stranger_rows(snapshot, i)) is not None:
        found.append(ahead)
    span = spans(snapshot.length, ground.length[snapshot.movement], ground.turns_back[snapshot.movement])
    for j in limits.leaders[i][limits.leaders[i] >= 0]:
        parted = float(ground.apart[snapshot.movement[i], snapshot.movement[j]])
        found.append(_leader_rows(snapshot, book, exits, int(j), float(span[j]), 0.0, own, parted))
    if not found:
        return NOBODY
    room, v, late_room, late_v, b = zip(*found, strict=True)
    return Leaders(np.stack(room), np.stack(v), np.stack(late_room), np.stack(late_v), np.array(b))


_FAR = np.full((1, HORIZON), NEVER)
NOBODY = Leaders(_FAR, _FAR, _FAR, _FAR, np.ones(1))


def _leader_rows(
    snapshot: Snapshot,
    book: Book,
    exits: Ways,
    j: int,
    span: float,
    shift: float,
    merge_at: float,
    parted_at: float | None,
) -> Rows:
    """(room, v, worst-case room, worst-case v, b) behind vehicle j, which is `span` long.

    No limit before it has merged, or, out of the same lane, once its rear is past where the two part.
    """
    b = float(snapshot.b_max[j])
    reservation = book.held.get(snapshot.ids[j])
    if reservation is not None:
        k = reservation.step(snapshot.cycle)
        x, v = _onward(reservation.x, reservation.v, k), _from(reservation.v, k)
        late_x, late_v = _from(reservation.late_x, k), _from(reservation.late_v, k)
    elif j in exits:
        way = exits[j]
        x, v, late_x, late_v = way.x, way.v, way.late_x, way.late_v
    else:
        x, v = resting(-float(snapshot.s[j]), float(snapshot.v[j]), b, brake=False)
        late_x, late_v = resting(-float(snapshot.s[j]), float(snapshot.v[j]), b, brake=True)
    back = span + motion.REAR_GAP_M - shift
    room, late_room = x - back, late_x - back
    if parted_at is None:
        room = np.where(x + shift >= merge_at, room, NEVER)
        late_room = np.where(late_x + shift >= merge_at, late_room, NEVER)
    else:
        rear = float(snapshot.length[j]) + parted_at
        room, late_room = np.where(x >= rear, NEVER, room), np.where(late_x >= rear, NEVER, late_room)
    return room, v, late_room, late_v, b


def _from(array: Floats, k: int) -> Floats:
    """The array from index k on, its last value repeated to full length."""
    return np.concatenate((array[k:], np.full(k, array[-1])))


def _onward(x: Floats, v: Floats, k: int) -> Floats:
    """Positions from index k on; past its end a profile goes on at its last speed.

    If it stood still there its follower's would stop behind it, that one's follower's a little sooner, and so on
    through an unbroken platoon, until a vehicle stops in the conflict zone for nothing. Worst cases may stand still:
    they are brought up to date every control cycle.
    """
    return np.concatenate((x[k:], x[-1] + v[-1] * STEP_S * np.arange(1, k + 1)))


def crossing(
    snapshot: Snapshot,
    ground: Ground,
    stack: Stack,
    leaders: Leaders,
    i: int,
    slot: float,
    parameters: Parameters,
) -> Reservation | None:
    """A crossing of vehicle i that is disjoint from every reservation, aimed at its slot or later; None if none is."""
    interlock = parameters.interlock
    movement, footprint = int(snapshot.movement[i]), int(snapshot.footprint[i])
    target = slot
    for _ in range(interlock.retries + 1):
        ways = _ways(snapshot, ground, leaders, i, target, parameters)
        if ways is None:
            return None
        x, v, late_x, late_v, done = ways
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


def _ways(
    snapshot: Snapshot, ground: Ground, leaders: Leaders, i: int, slot: float, parameters: Parameters
) -> tuple[Floats, Floats, Floats, Floats, int] | None:
    """(x, v, worst-case x, worst-case v, step clear in the worst case) of one crossing; None if it cannot be driven."""
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
    nominal = drive(
        -float(snapshot.s[i]), float(snapshot.v[i]), slot, body, way, manner_of(planner),
        leaders.room, leaders.v, leaders.b, x, v,
    )  # fmt: skip
    if nominal < 0:
        return None
    late = held_back(
        x[0], v[0], v, 0, (body[0], body[1], body[2]), way[2], _ahead(ground, movement, parameters),
        leaders.late_room, leaders.late_v, leaders.b, late_x, late_v,
    )  # fmt: skip
    if late < 0:
        return None
    return x, v, late_x, late_v, max(late, nominal)


def _ahead(ground: Ground, movement: int, parameters: Parameters) -> tuple[float, float, float]:
    """(deceleration, lowest speed) of the exit law and the end of sight on a movement's exit lane."""
    sight = min(float(ground.exit_length[movement]), parameters.exit.sight_m)
    floor = motion.OPENING_FLOOR * float(ground.exit_mps[movement])
    return max(parameters.exit.decel_mps2, motion.OPENING_DECEL_MPS2), floor, float(ground.length[movement]) + sight


def refresh(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, parameters: Parameters) -> tuple[str, ...]:
    """Bring the worst cases up to date, front to back, from where the vehicles are; those that have strayed.

    What leaders might have done since, they have not, so a worst case only gets better. A vehicle has strayed if
    it is ahead of its profile or behind the worst case it was reserved for.
    """
    row = {vehicle: i for i, vehicle in enumerate(snapshot.ids)}
    held = sorted(
        (float(snapshot.s[row[vehicle]]), vehicle)
        for vehicle, reservation in book.held.items()
        if reservation.clearance and vehicle in row
    )
    exits = exit_ways(snapshot, ground, limits, parameters)
    strayed = []
    for s, vehicle in held:
        i, reservation = row[vehicle], book.held[vehicle]
        k = reservation.step(snapshot.cycle)
        if snapshot.age[i] > 0.0 or k >= HORIZON - 2:
            continue
        if not reservation.late_x[k] - OFF_PROFILE_M <= -s <= reservation.x[k] + OFF_PROFILE_M:
            strayed.append(vehicle)
        leaders = leaders_of(snapshot, ground, book, limits, exits, i)
        late_x, late_v = reservation.late_x.copy(), reservation.late_v.copy()
        done = held_back(
            -s, float(snapshot.v[i]), reservation.v, k,
            (reservation.length, float(snapshot.a_max[i]), reservation.b),
            float(ground.clear[reservation.movement]), _ahead(ground, reservation.movement, parameters),
            leaders.late_room, leaders.late_v, leaders.b, late_x, late_v,
        )  # fmt: skip
        if done >= 0:
            book.add(replace(reservation, late_x=late_x, late_v=late_v))
    return tuple(strayed)


OFF_PROFILE_M = 0.4
"""A vehicle farther than this outside its profile and worst case has strayed: its windows may no longer hold."""


def intrusions(snapshot: Snapshot, limits: Limits) -> list[Reservation]:
    """Reservations for vehicles that may be in the conflict zone without a clearance.

    They hold the ground from the earliest they could be on it to the latest: full ahead, or at a crawl.
    """
    made = []
    for i in np.flatnonzero(limits.phase == INTRUDING):
        x0, v0 = -float(snapshot.s[i]), float(snapshot.v[i])
        times: Floats = np.arange(HORIZON, dtype=np.float64) * STEP_S
        fast: Floats = x0 + np.minimum(v0 + snapshot.a_max[i] * times, max(v0, snapshot.v_max[i])) * times
        slow: Floats = x0 + INTRUDER_MPS * times
        made.append(
            Reservation(
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
        )
    return made


INTRUDER_MPS = 2.0
"""A vehicle in the zone without a clearance may be this slow, m/s; reserved anew every control cycle."""
