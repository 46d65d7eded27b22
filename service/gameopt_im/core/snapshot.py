"""The frozen picture of one control cycle that every decision is a function of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]


NONE, FOREIGN = -1, -2
"""In place of a clearance's id."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state vectors `eq:eq2go_ext` of n vehicles, one array a component, in order of zone entry, then id.

    Distances in m, speeds in m/s, accelerations in m/s^2 (decelerations positive), times in s.
    `s` runs from the front bumper to the stop line, negative past it. `waited` counts from zone entry.
    `speed_priority` and `variation_priority` are Ps and Pv, already assigned from class and declared bid.
    `accepted` is the id of the clearance the vehicle says it follows, NONE for none, FOREIGN for one that another
    manager gave: where it leads is not in this one's books.
    `silent` marks vehicles whose state is predicted because nothing was heard of them this cycle; `age` is how
    long ago the state was that it was predicted from (0 where it is fresh), `heard_s` and `heard_v` what it said.
    `gap` is how far ahead its radar then saw a vehicle that the manager should know, bumper to bumper; infinite
    for none.
    `stranger_x` is where the rear of a stranger ahead is past the vehicle's own stop line, with its speed and
    deceleration; NEVER where there is none.
    """

    cycle: int
    time_s: float
    ids: tuple[str, ...]
    s: Floats
    v: Floats
    length: Floats
    a_max: Floats
    b_max: Floats
    v_max: Floats
    movement: Ints
    lane: Ints
    footprint: Ints
    waited: Floats
    assertiveness: Floats
    speed_priority: Floats
    variation_priority: Floats
    accepted: Ints
    silent: Bools
    age: Floats
    heard_s: Floats
    heard_v: Floats
    gap: Floats
    stranger_x: Floats
    stranger_v: Floats
    stranger_b: Floats

    def __len__(self) -> int:
        return len(self.ids)
