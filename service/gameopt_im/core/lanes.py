"""The bidders lane by lane, and what the vehicle ahead leaves the first of each lane. Compiled."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.reservations import LOOSE, Rows
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_im.core.windows import HORIZON, crossing_time, step_at, time_at
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S


@kernel
def lane_by_lane(among: Bools, lane: Ints, s: Floats) -> tuple[Ints, Ints]:
    """(indices, counts): the vehicles `among` all, lane by lane, the longest first, each front to back."""
    index = np.flatnonzero(among)
    size = np.zeros(lane.max() + 1 if lane.shape[0] else 0, np.int64)
    for i in index:
        size[lane[i]] += 1
    for key in (s, lane.astype(np.float64), -size[lane].astype(np.float64)):  # the last one decides
        index = index[np.argsort(key[index], kind="mergesort")]
    longest_first = np.sort(-size[size > 0])
    return index, -longest_first


@kernel
def floors_behind(head: Ints, leader: Ints, row: Ints, rows: Rows, cycle: int, b: Floats, headway_s: float) -> Floats:
    """(lanes,) earliest slot of the first bidder of each lane behind the cleared vehicle ahead of it, s."""
    floors = np.full(head.shape[0], -NEVER)
    for lane in range(head.shape[0]):
        i = head[lane]
        r = row[leader[i]] if leader[i] >= 0 else LOOSE
        if r < 0 or rows.clearance[r] == 0:
            continue
        cross, first = crossing_time(rows.x[r], rows.start[r], cycle), step_at(rows.start[r], cycle)
        back = rows.length[r] + motion.REAR_GAP_M
        passed = time_at(rows.x[r], first, back)
        speed = back / max(passed - cross, 0.05) if cross > 0.0 else rows.v[r, first]
        brake = max(0.0, 0.5 * speed * (1.0 / b[i] - 1.0 / rows.b[r]))
        floors[lane] = passed + headway_s + brake
    return floors


@kernel
def room_behind_leaders(
    head: Ints,
    leader: Ints,
    row: Ints,
    rows: Rows,
    cycle: int,
    s: Floats,
    v: Floats,
    length: Floats,
    gap_m: float,
    ends: Floats,
) -> Floats:
    """(lanes, H): how far the first bidder of each lane may go behind its leader by the `ends` of the blocks, m."""
    room = np.full((head.shape[0], ends.shape[0]), NEVER)
    for lane in range(head.shape[0]):
        i = head[lane]
        j = leader[i]
        if j < 0:
            continue
        r = row[j]
        for k in range(ends.shape[0]):
            if r < 0 or rows.clearance[r] == 0:
                ahead = -s[j] + v[j] * ends[k]
            else:
                ahead = rows.x[r, min(step_at(rows.start[r], cycle) + round(ends[k] / STEP_S), HORIZON - 1)]
            room[lane, k] = ahead - length[j] - gap_m + s[i]
    return room
