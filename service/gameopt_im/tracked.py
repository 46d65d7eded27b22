"""One vehicle as the manager knows it, and many as arrays: pure functions of what was last heard."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
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
    """What is known of n vehicles as numbers, by the names of `Snapshot`; `time` is that of their states."""

    time: Floats
    s: Floats
    v: Floats
    length: Floats
    a_max: Floats
    b_max: Floats
    v_max: Floats
    gap: Floats
    stranger_x: Floats
    stranger_v: Floats
    stranger_b: Floats
    entered: Floats
    setback: Floats
    assertiveness: Floats
    speed_priority: Floats
    variation_priority: Floats
    movement: Ints
    footprint: Ints
    accepted: Ints
    fallback: Ints
    vanished: Ints

    def only(self, kept: Bools) -> Heard:
        """Those of the vehicles that are kept."""
        return Heard._make(column[kept] for column in self)


REALS = Heard._fields.index("movement")
_PACK = struct.Struct(f"={REALS}d{len(Heard._fields) - REALS}q").pack


@dataclass(slots=True)
class Tracked:
    """A vehicle's latest state, and what was looked up once for it.

    `setback_m` is how far short of the line it keeps while it waits. `vanished` says that its liveliness token has
    gone since its last state. `record` is all that as a row of `Heard`, made when a message comes, so that a control
    cycle only has to join them; `note` renews it after a change.
    """

    state: State
    entered_s: float
    movement: int
    footprint: int
    bounds: VehicleClass
    priority: Priority
    setback_m: float = 0.0
    vanished: bool = False
    record: bytes = b""

    def note(self, term: int) -> None:
        """Renew the record; `term` is the manager's own: an id of another is not in its books, though it may be."""
        state, stranger = self.state, self.state.stranger
        accepted = NONE if state.accepted is None else state.accepted if state.term == term else FOREIGN
        behind = (NEVER, 0.0, 1.0)
        if stranger is not None:
            behind = (stranger.gap_m - state.distance_m, stranger.speed_mps, stranger.decel_mps2)
        self.record = _PACK(
            state.time_s, state.distance_m, state.speed_mps, state.length_m, state.max_accel_mps2,
            state.max_decel_mps2, state.max_speed_mps, math.inf if state.leader_gap_m is None else state.leader_gap_m,
            *behind, self.entered_s, self.setback_m, *self.priority,
            self.movement, self.footprint, accepted, state.fallback, self.vanished,
        )  # fmt: skip


def same_body(one: State, other: State) -> bool:
    """Movement, length, width and class: what a clearance is given for; they may not change while it is held."""
    return (
        one.length_m == other.length_m
        and one.width_m == other.width_m
        and one.movement == other.movement
        and one.vehicle_class == other.vehicle_class
    )


def heard_of(present: Sequence[Tracked]) -> Heard:
    """The records of vehicles, in their order, by columns."""
    joined = b"".join([vehicle.record for vehicle in present])
    table = np.frombuffer(joined).reshape(len(present), len(Heard._fields)).T.copy()
    return Heard(*table[:REALS], *table[REALS:].view(np.int64))


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
