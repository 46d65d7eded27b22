"""Who is ahead of whom on a lane, and how fast rule 2 lets each go behind it. Compiled."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.snapshot import Floats, Ints
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S


@kernel
def lane_leaders(
    lane: Ints, movement: Ints, x: Floats, worst_x: Floats, length: Floats, apart: Floats, rank: Ints
) -> Ints:
    """(n, R): the next vehicle ahead of each on its own approach lane, across the line and beyond; -1 for none.

    One for each of the R movements that a lane may have: `rank` is a movement's column. Whose rear is past where its
    movement parts from the follower's (`apart`) leads it no more. Ahead is who is so even where it may be at worst:
    who is silent must not be taken to have overtaken.
    """
    leader = np.full((x.shape[0], rank.max() + 1), -1, np.int64)
    together, since = by_group(lane)
    for g in range(since.shape[0] - 1):
        lane_mates = together[since[g] : since[g + 1]]
        for i in lane_mates:
            for j in lane_mates:
                ahead = worst_x[j] > x[i] or (worst_x[j] == x[i] and j < i)
                parted = worst_x[j] - length[j] >= apart[movement[i], movement[j]]
                if j == i or not ahead or parted:
                    continue
                r = rank[movement[j]]
                if leader[i, r] < 0 or worst_x[j] < worst_x[leader[i, r]]:
                    leader[i, r] = j
    return leader


@kernel
def by_group(group: Ints) -> tuple[Ints, Ints]:
    """(n,) the indices of n members by their group's number, and where each group begins in them, and the end."""
    together = np.argsort(group, kind="mergesort")
    names = group[together]
    changes = np.flatnonzero(names[1:] != names[:-1]) + 1
    return together, np.concatenate((np.array([0]), changes, np.array([together.shape[0]])))


@kernel
def nearest(leaders: Ints, x: Floats) -> Ints:
    """(n,): the nearest of several leaders, -1 where there is none."""
    first = np.full(leaders.shape[0], -1, np.int64)
    for i in range(leaders.shape[0]):
        for j in leaders[i]:
            if j >= 0 and (first[i] < 0 or x[j] < x[first[i]]):
                first[i] = j
    return first


@kernel
def exit_leaders(exit_lane: Ints, along: Floats, worst: Floats) -> Ints:
    """The next vehicle ahead of each on its exit lane, from whatever lane it came; -1 for none.

    `along` is the front's distance past the start of the exit lane, `worst` the same at worst; only leaders surely
    on it (worst >= 0) count.
    """
    leader = np.full(along.shape[0], -1, np.int64)
    together, since = by_group(exit_lane)
    for g in range(since.shape[0] - 1):
        bound_alike = together[since[g] : since[g + 1]]
        for i in bound_alike:
            for j in bound_alike:
                if j == i or worst[j] < 0.0 or worst[j] <= along[i]:
                    continue
                if leader[i] < 0 or worst[j] < worst[leader[i]]:
                    leader[i] = j
    return leader


@kernel
def follow_limit(
    x: Floats, v: Floats, length: Floats, b: Floats, worst_x: Floats, worst_v: Floats, leader: Ints, offset: Floats
) -> Floats:
    """Rule 2 for each vehicle behind `leader`, m/s; NEVER without one.

    `x + offset` are positions on a common path; a leader counts as where it may be at worst.
    """
    n = x.shape[0]
    out = np.full(n, NEVER)
    for i in range(n):
        j = leader[i]
        if j < 0:
            continue
        gap = worst_x[j] + offset[j] - length[j] - motion.REAR_GAP_M - x[i] - offset[i]
        out[i] = motion.follow_speed(gap, v[i], b[i], worst_v[j], b[j], STEP_S)
    return out
