"""Whom a vehicle has to stay behind, and where those go: nominal and worst case, step by step from now.

A leader that holds a reservation follows its profile, one that is past the conflict zone its exit way; of any other
nothing is known, so it goes on at its speed, and in the worst case brakes fully from now. A vehicle's leaders are the
next ones ahead in its lane, whoever else is bound for its exit lane, and a stranger that its radar sees.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import NEVER, inlined, kernel
from gameopt_im.core.reservations import LOOSE, Rows
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S


class Scene(NamedTuple):
    """The n vehicles of a snapshot as one who grants clearances sees them; x is metres past the own stop line.

    `bound` is the exit lane, `path` the length of the way over the zone, `clear` where the rear stands clear, `span`
    how long a vehicle is to those behind it in its lane; `leaders` (n, R) and `downstream` as in `Limits`, `apart`
    (M, M) as in `Ground`. `floor` and `sight` are the lowest speed of the exit law and where sight ends on the exit
    lane, `decel` is the law's deceleration. `uncleared` ones lead nobody on an exit lane.
    `heard_x` and `heard_v` are what a vehicle said `ago` control cycles before this one, `cycle`. `way` is the row of
    a vehicle's reservation or exit way, LOOSE for none; `exiting` marks the latter, `asked` those whose clearance is
    asked back.
    """

    cycle: int
    x: Floats
    v: Floats
    length: Floats
    a: Floats
    b: Floats
    heard_x: Floats
    heard_v: Floats
    ago: Ints
    uncleared: Bools
    movement: Ints
    lane: Ints
    bound: Ints
    path: Floats
    clear: Floats
    span: Floats
    leaders: Ints
    downstream: Ints
    stranger_x: Floats
    stranger_v: Floats
    stranger_b: Floats
    floor: Floats
    sight: Floats
    decel: float
    apart: Floats
    way: Ints
    exiting: Bools
    asked: Bools


class Ways(NamedTuple):
    """Where everybody with a row goes, nominal and worst case, from control cycle `start` on (rows, HORIZON).

    Exit ways are worst cases only: nominally who is past the conflict zone goes on at its speed.
    """

    x: Floats
    v: Floats
    late_x: Floats
    late_v: Floats
    start: Ints


class Ahead(NamedTuple):
    """m leaders of one vehicle: their rows in `Ways`, and numbers (m, 7), by the columns below.

    `row` holds their nominal ways, LOOSE for who goes on at its speed, `late_row` their worst cases. The room behind a
    leader is its x less `BACK`. It counts from where its x + `SHIFT` reaches `SINCE` (it has merged) until x reaches
    `UNTIL` (it has parted). `X` and `V` are for those without a row.
    """

    row: Ints
    late_row: Ints
    number: Floats


X, V, B, BACK, SHIFT, SINCE, UNTIL = range(7)


@kernel
def ways_of(rows: Rows) -> Ways:
    """The ways in a book's rows."""
    return Ways(rows.x, rows.v, rows.late_x, rows.late_v, rows.start)


class Room(NamedTuple):
    """Where the m leaders of `ahead` let a vehicle go from `ago` control cycles before now, by `limit`.

    `x`, `v` (rows, K) are their ways, nominal or the worst case if `late`; each has `row` (m,) there, in which `first`
    is the index of now.
    """

    ahead: Ahead
    row: Ints
    first: Ints
    x: Floats
    v: Floats
    ago: int
    late: bool


@kernel
def room_behind(ahead: Ahead, late: bool, cycle: int, ago: int, ways: Ways) -> Room:
    """The room behind leaders from `ago` control cycles before this one, in the worst case if `late`."""
    row, way_x, way_v = (ahead.late_row, ways.late_x, ways.late_v) if late else (ahead.row, ways.x, ways.v)
    first = np.zeros(row.shape[0], np.int64)
    for m in range(row.shape[0]):
        if row[m] >= 0:
            first[m] = min(cycle - ago - ways.start[row[m]], ways.x.shape[1] - 1)
    return Room(ahead, row, first, way_x, way_v, ago, late)


@inlined
def limit(m: int, k: int, room: Room) -> tuple[float, float]:
    """(how far leader m lets one go at step k, NEVER where it does not count; its own speed then).

    Before its beginning a way came at its first speed. Past its end a profile goes on at its last speed: if it stood
    still there its follower's would stop behind it, that one's follower's a little sooner, and so on through an
    unbroken platoon, until a vehicle stops in the conflict zone for nothing. Worst cases may stand still: they are
    brought up to date every control cycle.
    """
    row, number = room.row[m], room.ahead.number[m]
    if row >= 0:
        step, last = room.first[m] + k, room.x.shape[1] - 1
        at = min(max(step, 0), last)
        x, v = room.x[row, at], room.v[row, at]
        x = x + v * STEP_S * min(0, step)
        if not room.late:
            x = x + v * STEP_S * max(0, step - last)
    else:
        time, x, v = (k - room.ago) * STEP_S, number[X], number[V]
        if room.late:
            moving = min(time, v / number[B])
            braking = max(moving, 0.0)
            x = x + v * moving - 0.5 * number[B] * (braking * braking)
            v = max(0.0, v - number[B] * max(time, 0.0))
        else:
            x = x + v * time
    counts = x + number[SHIFT] >= number[SINCE] and x < number[UNTIL]
    return (x - number[BACK] if counts else NEVER), v


@kernel
def room_of(x: Floats, v: Floats, b: float, back: float, since: float) -> Room:
    """The room behind one leader alone, on the way x, v (K,) in its worst case, from where its front is at `since`."""
    ahead, first = nobody(1), np.zeros(1, np.int64)
    ahead.number[0, B], ahead.number[0, BACK], ahead.number[0, SINCE] = b, back, since
    return Room(ahead, first, first, x.copy().reshape((1, -1)), v.copy().reshape((1, -1)), 0, True)


@kernel
def nobody(count: int) -> Ahead:
    """Places for `count` leaders, none of which counts yet."""
    ahead = Ahead(np.full(count, LOOSE), np.full(count, LOOSE), np.zeros((count, 7)))
    ahead.number[:, X], ahead.number[:, B] = NEVER, 1.0
    ahead.number[:, SINCE], ahead.number[:, UNTIL] = -NEVER, 2.0 * NEVER
    return ahead


@kernel
def _place(m: int, j: int, scene: Scene, ahead: Ahead) -> None:
    """Put vehicle j in place m."""
    ahead.late_row[m] = scene.way[j]
    if not scene.exiting[j]:
        ahead.row[m] = scene.way[j]
    ahead.number[m, X], ahead.number[m, V], ahead.number[m, B] = scene.x[j], scene.v[j], scene.b[j]


@kernel
def _place_stranger(m: int, i: int, scene: Scene, ahead: Ahead) -> None:
    """Put the stranger that i sees in place m."""
    ahead.number[m, X] = scene.stranger_x[i] - motion.REAR_GAP_M
    ahead.number[m, V], ahead.number[m, B] = scene.stranger_v[i], scene.stranger_b[i]


@kernel
def ahead_of(i: int, scene: Scene) -> Ahead:
    """The vehicles that i has to stay behind: its lane leaders, whoever is bound for its exit lane, and a stranger."""
    lane, bound = scene.lane[i], scene.bound[i]
    merging, count = np.empty(scene.x.shape[0], np.int64), 0
    for j in range(scene.x.shape[0]):
        if scene.bound[j] == bound and scene.lane[j] != lane and not scene.uncleared[j]:
            merging[count] = j
            count += 1
    ahead = nobody(count + scene.leaders.shape[1] + 1)
    number, m = ahead.number, 0
    for j in merging[:count]:
        _place(m, j, scene, ahead)
        number[m, SHIFT] = scene.path[i] - scene.path[j]
        number[m, BACK] = scene.length[j] + motion.REAR_GAP_M - number[m, SHIFT]
        number[m, SINCE] = scene.path[i]
        m += 1
    if scene.stranger_x[i] < NEVER:
        _place_stranger(m, i, scene, ahead)
        m += 1
    for j in scene.leaders[i]:
        if j >= 0:
            _place(m, j, scene, ahead)
            if scene.asked[j]:
                ahead.row[m] = ahead.late_row[m] = LOOSE  # it may wait at the line instead
            number[m, BACK] = scene.span[j] + motion.REAR_GAP_M
            number[m, UNTIL] = scene.span[j] + scene.apart[scene.movement[i], scene.movement[j]]
            m += 1
    return Ahead(ahead.row[:m], ahead.late_row[:m], number[:m])


@kernel
def ahead_on_exit(i: int, scene: Scene) -> Ahead:
    """The one that an exiting vehicle has to stay behind: the next on its exit lane, or else a stranger."""
    ahead = nobody(1)
    j = scene.downstream[i]
    if j >= 0 and scene.exiting[j]:
        _place(0, j, scene, ahead)
        ahead.number[0, BACK] = scene.length[j] + motion.REAR_GAP_M - (scene.path[i] - scene.path[j])
    elif scene.stranger_x[i] < NEVER:
        _place_stranger(0, i, scene, ahead)
    return ahead
