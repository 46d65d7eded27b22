"""The intersection map: approaches, movements, and where the bodies of two movements sweep the same ground."""

from __future__ import annotations

import hashlib
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from gameopt_wire.messages import Clock, Counter, Geometry, Message, Name, Profile

Intention = Literal["right", "straight", "left", "turnaround"]
INTENTION_NUMBER: dict[Intention, int] = {"right": 0, "straight": 1, "left": 2, "turnaround": 3}
"""The y of the paper's movement groups x-y."""

Metres = Annotated[float, Meta(ge=-1000.0, le=100_000.0)]
Point = tuple[float, float]


class Footprint(msgspec.Struct, frozen=True, kw_only=True):
    """A body size the conflict areas were swept with; a vehicle uses the smallest one that covers it."""

    name: Name
    length_m: Annotated[float, Meta(gt=0.0, le=40.0)]
    width_m: Annotated[float, Meta(gt=0.0, le=5.0)]


class Lane(msgspec.Struct, frozen=True, kw_only=True):
    """A lane of an approach; `zone_m` is how far upstream of the stop line the control zone reaches on it."""

    id: Name
    approach: Counter
    speed_limit_mps: Annotated[float, Meta(gt=0.0, le=100.0)]
    zone_m: Annotated[float, Meta(gt=0.0, le=5_000.0)]


class Movement(msgspec.Struct, frozen=True, kw_only=True):
    """From an approach lane to an exit lane over the conflict zone.

    `group` is the paper's x-y (road number, intention number); `id` is the group, with a suffix where several
    lanes share it. `length_m` runs from the stop line to the start of the exit lane, `path` is its centre line
    there. `turn_speed_mps` is the limit on the path while it turns, None where the lane's own limit holds.
    `clear_m` is how far past the stop line the rear must be to stand clear of every conflict area. An uncleared
    vehicle of footprint f stops `setback_m[f]` short of where it otherwise would: the tail of a turning neighbour
    needs the ground. Empty where none is needed.
    """

    id: Name
    group: Name
    lane: Counter
    exit_lane: Name
    exit_speed_mps: Annotated[float, Meta(gt=0.0, le=100.0)]
    exit_length_m: Annotated[float, Meta(ge=0.0, le=100_000.0)]
    intention: Intention
    length_m: Annotated[float, Meta(gt=0.0, le=1_000.0)]
    clear_m: Metres
    setback_m: list[Annotated[float, Meta(ge=0.0, le=50.0)]] = []
    turn_speed_mps: Annotated[float, Meta(gt=0.0, le=100.0)] | None
    path: list[Point]


class ConflictArea(msgspec.Struct, frozen=True, kw_only=True):
    """Where movements `a` and `b` (indices, a < b) sweep the same ground.

    `a_windows_m[f][g]` is (entry, exit) along a's path past its stop line for a body of footprint f on a against
    one of footprint g on b: the front at first touch, the rear at last touch; None where these two never touch.
    `b_windows_m[g][f]` is the same seen from b. `merge` marks two movements that leave by the same exit lane.
    `beside` marks two of one approach, where the tail of a turning body reaches over the lane next to it: the movements
    do not conflict as the paper has it, but the ground is shared all the same. Entries before the stop line are
    negative.
    """

    a: Counter
    b: Counter
    merge: bool
    beside: bool = False
    a_windows_m: list[list[tuple[float, float] | None]]
    b_windows_m: list[list[tuple[float, float] | None]]


class IntersectionMap(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="map"):
    """One intersection, derived from a SUMO net or written by hand; all distances along the path."""

    version: Annotated[int, Meta(ge=1, le=255)] = 1
    intersection: Name
    control_zone_m: Annotated[float, Meta(gt=0.0, le=5_000.0)]
    lanes: Annotated[list[Lane], Meta(min_length=1)]
    movements: Annotated[list[Movement], Meta(min_length=1)]
    footprints: Annotated[list[Footprint], Meta(min_length=1)]
    areas: list[ConflictArea]

    def footprint_of(self, length_m: float, width_m: float) -> int:
        """Index of the smallest footprint (by area) that covers a vehicle, else of the largest there is."""
        sizes = [(f.length_m * f.width_m, k) for k, f in enumerate(self.footprints)]
        covering = [
            size
            for size, f in zip(sizes, self.footprints, strict=True)
            if f.length_m >= length_m and f.width_m >= width_m
        ]
        return min(covering)[1] if covering else max(sizes)[1]

    def setback_of(self, movement: Movement, length_m: float, width_m: float) -> float:
        """How far short of the line a vehicle of this size waits for a movement, m."""
        return movement.setback_m[self.footprint_of(length_m, width_m)] if movement.setback_m else 0.0

    def covers(self, length_m: float, width_m: float) -> bool:
        """Whether any footprint covers a vehicle; where none does, nobody knows the ground that it needs."""
        return any(f.length_m >= length_m and f.width_m >= width_m for f in self.footprints)

    def digest(self) -> str:
        """A short hash of the whole map: equal digests mean manager and vehicles speak of the same ground."""
        return hashlib.sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()[:16]


class Charter(Message, frozen=True, kw_only=True, tag="charter"):
    """The manager's answer to a query of the map key: how it runs, and the map it runs on."""

    term: Counter
    clock: Clock
    profile: Profile
    geometry: Geometry
    turn_speed: bool
    candidates: Counter
    workers: Counter
    process_id: Counter
    digest: Name
    map: IntersectionMap
