"""What a slot leaves a vehicle: the corridor of its ways, and with it the bounds of the horizon program's rows.

Ways are m from now, by the ends of the program's blocks. Scalars in SI units; compiled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import NEVER, Manner, approach, approach_speed, has_to_go, kernel, waiting_speed
from gameopt_im.core.snapshot import Bools, Floats
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

FAR_MPS = 1e4
"""A bound beyond this is none: whoever has no leader is told to stay behind one who is farther off than that."""
SLACK_MPS = 0.1
"""Play left around the reference, m/s (of the mean speed for the corridor, of a change of speed for the boxes)."""


@kernel
def reference(
    s: Floats,
    v: Floats,
    slot: Floats,
    a: Floats,
    b: Floats,
    top: Floats,
    cap: Floats,
    manner: Manner,
    blocks: Floats,
) -> tuple[Floats, Floats, Floats]:
    """(speeds at block ends (n, H), line speed (n,), first rate (n,)) of each vehicle driving the approach law."""
    n, h = s.shape[0], blocks.shape[0]
    ends = np.cumsum(np.round(blocks / STEP_S)).astype(np.int64)
    room, speed = np.empty(ends[-1] + 1), np.empty(ends[-1] + 1)
    out, line, first = np.empty((n, h)), np.empty(n), np.empty(n)
    for i in range(n):
        plan = approach(s[i], v[i], slot[i], a[i], b[i], top[i], cap[i], manner)
        line[i], first[i] = plan[2], plan[1]
        turn_b = min(motion.TURN_DECEL_MPS2, b[i])
        room[0], speed[0] = s[i], v[i]
        went = _wait(room, speed, slot[i], plan[0], plan[1], a[i], b[i], top[i], cap[i])
        for k in range(went, ends[-1]):
            if room[k] > 0.0:
                to_go = slot[i] - k * STEP_S
                u = approach_speed(room[k], speed[k], to_go, plan[0], plan[1], a[i], top[i], cap[i], turn_b, STEP_S)
            else:
                u = min(cap[i], speed[k] + a[i] * STEP_S)
            _step(k, u, b[i], cap[i], room, speed)
        for block in range(h):
            out[i, block] = speed[ends[block]]
    return out, line, first


@kernel
def _wait(
    room: Floats, speed: Floats, slot: float, h: float, rate: float, a: float, b: float, top: float, cap: float
) -> int:
    """Drive by a plan as long as it waits, filling in both arrays; the step from which it may have to go full ahead.

    Whoever has to go has to ever after, if it does not: so that step is looked for by halves instead of at every one.
    """
    turn_b, last = min(motion.TURN_DECEL_MPS2, b), room.shape[0] - 1
    for k in range(last):
        if room[k] <= 0.0:
            last = k
            break
        _step(k, waiting_speed(speed[k], h, rate, a, turn_b, STEP_S), b, cap, room, speed)
    first = 0
    while first < last:
        middle = (first + last) // 2
        if has_to_go(room[middle], speed[middle], slot - middle * STEP_S, a, top, cap, turn_b, STEP_S):
            last = middle
        else:
            first = middle + 1
    return first


@kernel
def _step(k: int, u: float, b: float, cap: float, room: Floats, speed: Floats) -> None:
    """From step k on to the next one at the speed u, or what rule 3 and the brakes allow."""
    if u > cap and room[k] > 0.0:
        u = min(u, motion.turn_speed(room[k], speed[k], b, STEP_S, cap))
    u = max(0.0, u, speed[k] - b * STEP_S)
    room[k + 1] = room[k] - 0.5 * STEP_S * (speed[k] + u)
    speed[k + 1] = u


@kernel
def corridor(s: float, a: float, b: float, top: float, slot: float, line: float, end: float) -> tuple[float, float]:
    """(least, most) way by the time `end`, m, for crossing at `slot` with speed `line`.

    Most: at time tau before its slot the vehicle is at least where it has to start, accelerating at a, to reach
    the line speed at the line. Least: no farther from the line than full speed, braked for a turn, covers.
    """
    to_go = max(slot - end, 0.0)
    turn_b = min(motion.TURN_DECEL_MPS2, b)
    faster = min(to_go, max(top - line, 0.0) / turn_b)
    farthest = line * to_go + turn_b * faster * (to_go - 0.5 * faster)
    least = s - farthest + max(end - slot, 0.0) * line
    if slot <= end:
        return least, NEVER
    run = min(to_go, line / a)
    return least, s - (line * run - 0.5 * a * run**2)


class Bounds(NamedTuple):
    """l and u of every row of one candidate, (n, 4, H): corridor, speed, change, and the rear end behind the vehicle
    ahead in the arrays, which the first of a platoon does not follow: its row is in no program.

    `reference` (n, H) is the approach law's way, which they hold.
    """

    lower: Floats
    upper: Floats
    reference: Floats


class Approaching(NamedTuple):
    """The n vehicles whose bounds are worked out; the arrays as in `HorizonTask`."""

    s: Floats
    v: Floats
    length: Floats
    a: Floats
    b: Floats
    top: Floats
    cap: Floats
    room: Floats
    trails: Bools


@kernel
def bounds_of(who: Approaching, slot: Floats, blocks: Floats, manner: Manner, rear_gap: float) -> Bounds:
    """The bounds of one candidate; `slot` (n,) in s, `blocks` (H,) in s."""
    s, v, length, a, b, top, cap, room, trails = who
    n, h = s.shape[0], blocks.shape[0]
    speeds, lines, rates = reference(s, v, slot, a, b, top, cap, manner, blocks)
    lower, upper = np.full((n, 4, h), -np.inf), np.full((n, 4, h), np.inf)
    hardest = manner.decels[min(1, len(manner.decels) - 1)]
    way = np.empty((n, h))
    for i in range(n):
        start, before, end, covered = 0.5 * blocks[0] * v[i], v[i], 0.0, 0.0
        brake = max(-rates[i], hardest, 0.0)
        for k in range(h):
            speed = speeds[i, k]
            end += blocks[k]
            covered += 0.5 * blocks[k] * (before + speed)
            way[i, k] = covered
            least, most = corridor(s[i], a[i], b[i], top[i], slot[i], lines[i], end)
            lower[i, 0, k] = (min(least, covered) - start) / end - SLACK_MPS
            most = min(most, room[i, k])
            if trails[i]:
                most = min(most, way[i - 1, k] + s[i] - s[i - 1] - length[i - 1] - rear_gap)
            upper[i, 0, k] = (max(most, covered) - start) / end + SLACK_MPS
            lower[i, 1, k], upper[i, 1, k] = 0.0, max(top[i], speed)
            now = v[i] if k == 0 else 0.0  # what is given of the first change of speed
            lower[i, 2, k] = min(-brake * blocks[k], speed - before) - SLACK_MPS + now
            upper[i, 2, k] = max(a[i] * blocks[k], speed - before) + SLACK_MPS + now
            if i > 0:
                gap = s[i] - s[i - 1] - length[i - 1] - rear_gap
                behind = max(gap, covered - way[i - 1, k])
                upper[i, 3, k] = (behind - 0.5 * blocks[0] * (v[i] - v[i - 1])) / end + SLACK_MPS
            before = speed
    return Bounds(lower, upper, speeds)
