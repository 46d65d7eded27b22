"""One vehicle as the manager knows it, and many as arrays: pure functions of what was last heard."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gameopt_im.core.bids import Priority
from gameopt_im.core.conflicts import Ground
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.parameters import VehicleClass
from gameopt_im.core.snapshot import FOREIGN, NONE, Bools, Floats, Ints, Snapshot
from gameopt_im.core.tracking import seen
from gameopt_wire.messages import State


class Heard(NamedTuple):
    """What is known of n vehicles as numbers, by the names of `Snapshot`; `time` is that of their states.

    First what a state says anew every time, then what is known besides; of either first the reals, then the integers.
    """

    time: Floats
    s: Floats
    v: Floats
    a_max: Floats
    b_max: Floats
    v_max: Floats
    gap: Floats
    stranger_x: Floats
    stranger_v: Floats
    stranger_b: Floats
    accepted: Ints
    fallback: Ints
    length: Floats
    entered: Floats
    setback: Floats
    assertiveness: Floats
    speed_priority: Floats
    variation_priority: Floats
    movement: Ints
    footprint: Ints
    vanished: Ints

    def only(self, kept: Bools) -> Heard:
        """Those of the vehicles that are kept."""
        return Heard._make(column[kept] for column in self)


class Said(NamedTuple):
    """What a state says, by the names of `Heard`."""

    time: float
    s: float
    v: float
    a_max: float
    b_max: float
    v_max: float
    gap: float
    stranger_x: float
    stranger_v: float
    stranger_b: float
    accepted: int
    fallback: int


SAID, KNOWN = struct.Struct("=10d2q"), struct.Struct("=6d3q")
INTEGERS = frozenset(("accepted", "fallback", "movement", "footprint", "vanished"))
"""The fields of `Heard` that are a q of `SAID` or `KNOWN`."""


class Body(NamedTuple):
    """What a clearance is given for: it may not change while one is held."""

    movement: str
    length_m: float
    width_m: float
    vehicle_class: str


@lru_cache(1024)
def shared(body: Body) -> Body:
    """The same body, one object for all vehicles alike: what many are compared with stays near the processor."""
    return body


@dataclass(slots=True)
class Tracked:
    """What was last heard of a vehicle, and what was looked up once for it.

    `setback_m` is how far short of the line it keeps while it waits. `vanished` says that its liveliness token has
    gone since its last state. `record` is its row of `Heard`, so that a control cycle only has to join them: `hear`
    writes what a state says, `note` what is known besides after a change. The state itself is not kept. One that is
    let go at once leaves its memory to the next; hundreds that are kept for a control cycle have left the processor's
    cache by then, and are slow to replace.
    """

    name: str
    body: Body
    entered_s: float
    movement: int
    footprint: int
    bounds: VehicleClass
    priority: Priority
    setback_m: float = 0.0
    vanished: bool = False
    time_s: float = 0.0
    record: bytearray = field(default_factory=lambda: bytearray(SAID.size + KNOWN.size))

    def hear(self, state: State, term: int) -> None:
        """Take in a state; `term` is the manager's own: an id of another is not in its books, though it may be."""
        accepted = NONE if state.accepted is None else state.accepted if state.term == term else FOREIGN
        stranger, behind = state.stranger, (NEVER, 0.0, 1.0)
        if stranger is not None:
            behind = (stranger.gap_m - state.distance_m, stranger.speed_mps, stranger.decel_mps2)
        self.time_s = state.time_s
        SAID.pack_into(
            self.record, 0, state.time_s, state.distance_m, state.speed_mps, state.max_accel_mps2, state.max_decel_mps2,
            state.max_speed_mps, math.inf if state.leader_gap_m is None else state.leader_gap_m,
            *behind, accepted, state.fallback,
        )  # fmt: skip
        if self.vanished:
            self.vanished = False
            self.note()

    def note(self) -> None:
        """Renew what is known besides its states."""
        KNOWN.pack_into(
            self.record, SAID.size, self.body.length_m, self.entered_s, self.setback_m, *self.priority,
            self.movement, self.footprint, self.vanished,
        )  # fmt: skip

    @property
    def last(self) -> Said:
        """What its last state said."""
        return Said._make(SAID.unpack_from(self.record))


def heard_of(present: Sequence[Tracked]) -> Heard:
    """The rows of vehicles, in their order, by columns."""
    joined = b"".join([vehicle.record for vehicle in present])
    table = np.frombuffer(joined).reshape(len(present), len(Heard._fields)).T.copy()
    return Heard._make(
        column.view(np.int64) if name in INTEGERS else column for name, column in zip(Heard._fields, table, strict=True)
    )


def picture(
    cycle: int, time_s: float, ids: tuple[str, ...], heard: Heard, reserved: Bools, ground: Ground, silent_s: float
) -> Snapshot:
    """The snapshot of vehicles by their records; states older than `silent_s` are marked silent."""
    movement = heard.movement
    s, v, v_max, age, waited, heard_s, heard_v, silent = seen(
        heard.time, heard.s, heard.v, heard.b_max, heard.v_max, heard.setback, heard.entered, heard.accepted,
        heard.vanished, movement, reserved, ground.limit_mps, ground.exit_mps, time_s, silent_s,
    )  # fmt: skip
    return Snapshot(
        cycle=cycle,
        time_s=time_s,
        ids=ids,
        s=s,
        v=v,
        length=heard.length,
        a_max=heard.a_max,
        b_max=heard.b_max,
        v_max=v_max,
        movement=movement,
        lane=ground.lane[movement],
        footprint=heard.footprint,
        waited=waited,
        assertiveness=heard.assertiveness,
        speed_priority=heard.speed_priority,
        variation_priority=heard.variation_priority,
        accepted=heard.accepted,
        silent=silent,
        age=age,
        stranger_x=heard.stranger_x,
        stranger_v=heard.stranger_v,
        stranger_b=heard.stranger_b,
        heard_s=heard_s,
        heard_v=heard_v,
        gap=heard.gap,
    )
