"""Complete speed profiles through the conflict zone, nominal and worst case.

Positions x are metres of the front bumper past the stop line (x = -s), sampled every STEP_S from the control
cycle a profile was made in. Every array is HORIZON steps long: past its end a profile goes on at its last speed. The
worst case begins with a standing vehicle where the sight on the exit ends; everyone before it brakes as rule 2
makes it, and slows down to open its headway once it is clear.
"""

from __future__ import annotations

from gameopt_im.core.kinematics import NEVER, Manner, approach, approach_speed, inlined, kernel
from gameopt_im.core.leading import B as LEAD_B
from gameopt_im.core.leading import Room, limit
from gameopt_im.core.snapshot import Floats
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S

RULE_TOLERANCE_MPS = 1e-6
"""A vehicle that rides a rule's curve exactly is not past it."""
STOP_PLAY_M = 0.03
"""A stop that ends within a step goes up to b dt^2 / 8 too far; rule 2 is failed only by more than this."""


@inlined
def follow(x: float, v: float, b: float, u: float, k: int, room: Room) -> tuple[float, bool]:
    """(u, or rule 2 at step k behind every leader where that is less, m/s; whether it can be kept by braking fully)."""
    possible = True
    floor = v - b * STEP_S
    for m in range(room.first.shape[0]):
        end, lead_v = limit(m, k, room)
        if end >= NEVER:
            continue
        gap, lead_b = end - x, room.ahead.number[m, LEAD_B]
        if motion.may_drive(max(u, floor), gap + motion.reach(lead_v, lead_b, STEP_S), v, min(b, lead_b), STEP_S):
            continue
        rule = motion.follow_speed(gap, v, b, lead_v, lead_b, STEP_S)
        if rule < floor and motion.follow_speed(gap + STOP_PLAY_M, v, b, lead_v, lead_b, STEP_S) < floor:
            possible = False
        u = min(u, rule)
    return u, possible


@kernel
def drive(
    x0: float,
    v0: float,
    slot: float,
    body: tuple[float, float, float, float, float],
    way: tuple[float, float, float, float, float],
    manner: Manner,
    room: Room,
    x: Floats,
    v: Floats,
) -> int:
    """Drive from (x0, v0) over the line at `slot` and through the zone, under rules 2 and 3; fills x and v.

    body = (length, planned acceleration, deceleration, top speed upstream, top speed on the exit).
    way = (turning speed or NEVER, path length over the zone, distance at which the rear stands clear, line speed
    cap, slot-less flag > 0 for full ahead). After the rear is clear the vehicle speeds up for its exit: if one that had
    to creep were taken to creep on, whoever is cleared behind it would, and everyone behind that one, for minutes.
    Returns the step at which the rear is clear, or -1 where rule 2 cannot be kept or the way takes too long.
    """
    length, a, b, top, exit_top = body
    turn, path, clear, cap, slotless = way
    turn_b = min(motion.TURN_DECEL_MPS2, b)
    h, rate = top, a
    if slotless <= 0.0 and x0 < 0.0:
        plan = approach(-x0, v0, slot, a, b, top, cap, manner)
        h, rate = plan[0], plan[1]
    x[0], v[0] = x0, v0
    done = -1
    for k in range(x.shape[0] - 1):
        s = -x[k]
        if done >= 0:
            u = min(v[k] + a * STEP_S, max(v[k], exit_top))
        else:
            most = top if s > 0.0 else exit_top
            if s > 0.0:
                most = min(most, motion.turn_speed(s, v[k], b, STEP_S, turn))
            elif x[k] < path:
                most = min(most, turn)
            if slotless <= 0.0 and s > 0.0:
                u = approach_speed(s, v[k], slot - k * STEP_S, h, rate, a, top, cap, turn_b, STEP_S)
            else:
                u = v[k] + a * STEP_S
            u = min(u, most)
        u, possible = follow(x[k], v[k], b, u, k, room)
        if done < 0 and not possible:
            return -1
        u = max(0.0, u, v[k] - b * STEP_S)
        v[k + 1] = u
        x[k + 1] = x[k] + 0.5 * STEP_S * (v[k] + u)
        if done < 0 and x[k + 1] - length >= clear and x[k + 1] >= path:
            done = k + 1
    return done


@kernel
def held_back(
    x0: float,
    v0: float,
    v: Floats,
    first: int,
    body: tuple[float, float, float],
    clear: float,
    law: tuple[float, float, float],
    room: Room,
    late_x: Floats,
    late_v: Floats,
) -> int:
    """The worst case from (x0, v0) at step `first` on: every leader at its own worst; fills late_x, late_v from there.

    The vehicle keeps to its profile's speeds v as far as rule 2 lets it. Once its rear is clear it may slow down to
    open its headway, and have to stop where the sight on its exit ends: `law` = (deceleration and lowest speed of the
    exit law, end of sight). body = (length, acceleration, deceleration).
    Returns the step at which the rear is clear, -1 if it never is, or if rule 2 asks for more than the brakes can do;
    the ways are filled in all the same.
    """
    length, a, b = body
    late_x[first], late_v[first] = x0, v0
    x, now = x0, v0
    done, kept = first if x0 - length >= clear else -1, True
    for k in range(first, v.shape[0] - 1):
        if done >= 0:
            u = min(now, max(law[1], now - law[0] * STEP_S))
            if not motion.may_drive(u, law[2] - x, now, b, STEP_S):
                u = min(u, motion.brake_speed(law[2] - x, now, b, STEP_S, 0.0))
        else:
            u = min(v[k + 1], now + a * STEP_S)
        u, possible = follow(x, now, b, u, k - first, room)
        kept = kept and (possible or done >= 0)
        u = max(0.0, now - b * STEP_S, u)
        if done >= 0 and now <= 0.0:  # it stands, and will: the rest is soon said
            late_v[k + 1 :], late_x[k + 1 :] = 0.0, x
            break
        x, now = x + 0.5 * STEP_S * (now + u), u
        late_x[k + 1], late_v[k + 1] = x, u
        if done < 0 and x - length >= clear:
            done = k + 1
    return done if kept else -1
