"""What one step of the simulation shows of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass

STEP_S = 0.1
"""Length of a simulation step, s."""
EXIT_RANGE_M = 250.0
"""A vehicle is observed and controlled this far past the conflict zone, or to the end of its exit edge."""


@dataclass(frozen=True, slots=True)
class Observation:
    """What a vehicle senses after a step, and what its type can do.

    `movement` is the map's movement id. `distance_m` runs along the path from the front bumper to the stop
    line, negative beyond it, on the exit lane too. The leader is the nearest vehicle ahead on the path, its
    gap bumper to bumper; None with a free road. It is `leader_strange` if nobody controls it, or if it only shares
    the way to the approach and is bound for another lane. `controlled` is False once released, and where the simulation
    only watches.
    """

    vehicle: str
    movement: str
    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    length_m: float
    width_m: float
    vehicle_class: str
    max_speed_mps: float
    max_accel_mps2: float
    max_decel_mps2: float
    leader_gap_m: float | None
    leader_speed_mps: float | None
    leader_decel_mps2: float | None
    leader_strange: bool
    controlled: bool


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a vehicle stands: front bumper centre in net coordinates, angle as SUMO gives it.

    The angle is in degrees clockwise from north; `lane` is the one under the front bumper.
    """

    vehicle: str
    x_m: float
    y_m: float
    angle_deg: float
    length_m: float
    width_m: float
    speed_mps: float
    lane: str


@dataclass(slots=True)
class Vehicle:
    """The simulation's record of a vehicle: its type's values, read once, and what it is doing."""

    id: str
    length_m: float
    width_m: float
    vehicle_class: str
    max_speed_mps: float
    max_accel_mps2: float
    max_decel_mps2: float
    lane: str = ""
    movement: int | None = None
    halts: bool = False
    """It has planned a stop on its way to the line."""
    stop_m: float | None = None
    """Where it has planned to stop on the exit lane that it is on."""
    controlled: bool = False
    released: bool = False
    route_id: str = ""
    route: tuple[str, ...] = ()
    """While it is taken over, the route that it is on."""
    rerouting_period: str | None = None
    """How often SUMO looked for a better route for it before; None where it never does."""


@dataclass(frozen=True, slots=True)
class Departure:
    """A vehicle at the start of its way, or of the part of it that matters: `route` begins with its edge."""

    id: str
    scheduled_s: float
    route: tuple[str, ...]
    position_m: float
    max_speed_mps: float
