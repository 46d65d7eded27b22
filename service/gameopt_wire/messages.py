"""The messages between vehicles and the intersection manager.

Every message is a msgpack map with a `type` tag and a `version`; a reader ignores fields it does not know.
Units are in the names: `_s` seconds, `_m` metres, `_mps` m/s, `_mps2` m/s^2. Times are absolute: seconds since
the Unix epoch under the wall clock, simulated seconds in lock-step.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

WIRE_VERSION = 1
"""Raised when a field changes its meaning; new fields do not raise it."""

STEP_S = 0.1
"""Length of a control cycle and of a step of a speed profile, s (the paper's Delta t)."""

VehicleId = Annotated[str, Meta(min_length=1, max_length=64)]
Name = Annotated[str, Meta(min_length=1, max_length=128)]
Time = Annotated[float, Meta(ge=0.0, le=1e11)]
Distance = Annotated[float, Meta(ge=-5_000.0, le=5_000.0)]
Speed = Annotated[float, Meta(ge=0.0, le=100.0)]
Acceleration = Annotated[float, Meta(ge=-50.0, le=50.0)]
Capability = Annotated[float, Meta(ge=0.1, le=30.0)]
Counter = Annotated[int, Meta(ge=0, le=2**62)]

Clock = Literal["wall", "lockstep"]
Profile = Literal["default", "paper"]
Geometry = Literal["areas", "box"]


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", gc=False):
    """Common to all messages: the wire version they were written with."""

    version: Annotated[int, Meta(ge=1, le=255)] = WIRE_VERSION


class Stranger(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """The next vehicle ahead on the path, where the manager cannot know that it is.

    Nobody controls it, or it is bound for another lane and only shares the way to the approach. `gap_m` is bumper
    to bumper.
    """

    gap_m: Distance
    speed_mps: Speed
    decel_mps2: Capability


class State(Message, frozen=True, kw_only=True, tag="state", gc=False):
    """What a vehicle says of itself every control cycle (`eq:eq2go_ext` without what is private or derived).

    `distance_m` runs along the path from the front bumper to the stop line, negative once past it.
    `accepted` is the id of the clearance the vehicle follows, with the `term` of the manager that gave it.
    `stranger` is what its radar sees ahead and the manager does not.
    `leader_gap_m` is the way to any other vehicle ahead, bumper to bumper; null with none, or no radar.
    """

    vehicle: VehicleId
    time_s: Time
    movement: Name
    distance_m: Distance
    speed_mps: Speed
    acceleration_mps2: Acceleration
    length_m: Annotated[float, Meta(gt=0.0, le=40.0)]
    width_m: Annotated[float, Meta(gt=0.0, le=5.0)]
    vehicle_class: Name
    max_speed_mps: Annotated[float, Meta(gt=0.0, le=100.0)]
    max_accel_mps2: Capability
    max_decel_mps2: Capability
    term: Counter = 0
    accepted: Counter | None = None
    fallback: bool = False
    stranger: Stranger | None = None
    leader_gap_m: Distance | None = None


class Bid(Message, frozen=True, kw_only=True, tag="bid", gc=False):
    """A vehicle's bid: the declared assertiveness A, nothing else. The private preference never leaves it."""

    vehicle: VehicleId
    time_s: Time
    assertiveness: Annotated[float, Meta(ge=0.0, le=100.0)]


class Clearance(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """An offer to cross: the speed at `start_s + k * STEP_S` for k = 0, 1, …, to be followed exactly.

    The vehicle takes it only before `expires_s` and only while it is still on the profile.
    """

    id: Counter
    start_s: Time
    expires_s: Time
    speeds_mps: Annotated[list[Speed], Meta(min_length=1, max_length=1200)]


class Command(Message, frozen=True, kw_only=True, tag="command", gc=False):
    """What a vehicle is sent: its slot, its speed for the next step and, when its turn has come, a clearance.

    `speed_mps` is to be reached at `time_s + STEP_S`; the command holds until `valid_until_s`.
    `rank` counts from 0 in the crossing order; `price` is what the clearance costs when it is accepted.
    `cleared` is the id of the clearance that the manager knows to be accepted: only then does the speed take it
    into account, and may slow a vehicle that follows its profile.
    `withdrawn` is the id of a clearance that is asked back: a vehicle that can still stop before the line drops it, and
    drives by the speed; any other drives it to its end.
    """

    vehicle: VehicleId
    term: Counter
    cycle: Counter
    time_s: Time
    speed_mps: Speed
    valid_until_s: Time
    slot_s: Time | None = None
    clearance: Clearance | None = None
    cleared: Counter | None = None
    withdrawn: Counter | None = None
    rank: Annotated[int, Meta(ge=-1, le=100_000)] = -1
    price: Annotated[float, Meta(ge=0.0, le=1e9)] = 0.0


class Step(Message, frozen=True, kw_only=True, tag="step", gc=False):
    """Lock-step only: the simulator has published `messages` states and bids for control cycle `cycle`.

    Each carries `codec.step_mark(cycle)` as its Zenoh attachment; what comes without it does not count.
    """

    cycle: Counter
    time_s: Time
    messages: Counter


class CycleReport(Message, frozen=True, kw_only=True, tag="cycle"):
    """One per control cycle, after its commands. Counters with `_total` run from the start of the term.

    `elapsed_ms` is the decision, from messages to commands. `whole_ms` is the whole way, of which `stages_ms` are the
    parts: from the last state that was waited for to the last command handed to Zenoh. `late_ms` is how long after its
    time under the wall clock the control cycle began. Both are null where nobody has measured them.

    For want of time, `dropped_total` candidates were not tried, and `unsolved_total` control cycles went without
    programs.
    """

    term: Counter
    cycle: Counter
    time_s: Time
    vehicles: Counter
    uncleared: Counter
    cleared: Counter
    commands: Counter
    candidates: Counter
    selected: int
    order: list[VehicleId]
    granted: list[VehicleId]
    refused: Counter = 0
    withdrawn: Counter = 0
    delay_s: float
    elapsed_ms: float
    stages_ms: dict[str, float]
    whole_ms: float | None = None
    late_ms: float | None = None
    qp_solved_total: Counter
    qp_failed_total: Counter
    qp_late_total: Counter
    missed_total: Counter
    received_total: Counter
    rejected_total: dict[str, int]
    fallback: Counter
    silent: Counter
    dropped_total: Counter = 0
    unsolved_total: Counter = 0


class LedgerEntry(Message, frozen=True, kw_only=True, tag="ledger", gc=False):
    """What a vehicle paid for its clearance and, once it has left the zone, when it left."""

    vehicle: VehicleId
    term: Counter
    entered_s: Time
    cleared_s: Time
    price: float
    bid: float
    left_s: Time | None = None
