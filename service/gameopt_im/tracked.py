"""One vehicle as the manager knows it, and the snapshot of many: pure functions of what was last heard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gameopt_im.core.bids import Priority
from gameopt_im.core.conflicts import Ground
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.parameters import VehicleClass
from gameopt_im.core.snapshot import FOREIGN, NONE, Snapshot
from gameopt_wire.messages import STEP_S, State
from gameopt_wire.motion import STOP_OFFSET_M


@dataclass(slots=True)
class Tracked:
    """A vehicle's latest state, and what was looked up once for it.

    `setback_m` is how far short of the line it keeps while it waits. `reserved` says that the manager's own books
    have a clearance for it, `vanished` that its liveliness token has gone since its last state.
    """

    state: State
    entered_s: float
    movement: int
    footprint: int
    bounds: VehicleClass
    priority: Priority
    setback_m: float = 0.0
    reserved: bool = False
    vanished: bool = False

    @property
    def holds_clearance(self) -> bool:
        """By the manager's books, or by what the vehicle says."""
        return self.reserved or self.state.accepted is not None

    @property
    def could_stop(self) -> bool:
        """Whether it could come to a stand before the line when last heard.

        A vehicle that rides rule 1's curve exactly could: that curve ends `STOP_OFFSET_M` before the line.
        """
        return self.state.speed_mps**2 <= 2.0 * self.state.max_decel_mps2 * self.state.distance_m


def same_body(one: State, other: State) -> bool:
    """Movement, length, width and class: what a clearance is given for; they may not change while it is held."""
    return (
        one.length_m == other.length_m
        and one.width_m == other.width_m
        and one.movement == other.movement
        and one.vehicle_class == other.vehicle_class
    )


def predict(vehicle: Tracked, time_s: float) -> tuple[float, float]:
    """Distance to the line and speed at `time_s`, at constant speed.

    Without a clearance a vehicle that can stop does so by itself (rule 1), so it is predicted no further than
    where it would stand. A state from just after the control cycle's time is taken back, one step at most.
    """
    state = vehicle.state
    age_s = max(time_s - state.time_s, -STEP_S)
    s, v = state.distance_m - state.speed_mps * age_s, state.speed_mps
    if age_s > 0.0 and vehicle.could_stop and not vehicle.holds_clearance:
        rest = min(state.distance_m, vehicle.setback_m + STOP_OFFSET_M)
        s = max(s, rest)
        v = min(v, math.sqrt(2.0 * state.max_decel_mps2 * (s - rest)))
    return s, v


def picture(
    cycle: int, time_s: float, present: Sequence[Tracked], ground: Ground, *, term: int, silent_s: float
) -> Snapshot:
    """The snapshot of `present`, in their order; states older than `silent_s` are marked silent."""
    states = [vehicle.state for vehicle in present]
    strangers = [(state.stranger, state) for state in states]

    def reals(values: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array(values, dtype=np.float64)

    predicted = [predict(vehicle, time_s) for vehicle in present]
    s = reals([distance for distance, _ in predicted])
    movement = np.array([vehicle.movement for vehicle in present], dtype=np.int64)
    limit = np.where(s > 0.0, ground.limit_mps[movement], ground.exit_mps[movement])
    # A clearance of another term is not in this manager's books, though its id may be.
    accepted = [
        NONE if state.accepted is None else state.accepted if state.term == term else FOREIGN for state in states
    ]
    v = reals([speed for _, speed in predicted])
    age = np.maximum(time_s - reals([state.time_s for state in states]), 0.0)
    return Snapshot(
        cycle=cycle,
        time_s=time_s,
        ids=tuple(state.vehicle for state in states),
        s=s,
        v=v,
        length=reals([state.length_m for state in states]),
        a_max=reals([state.max_accel_mps2 for state in states]),
        b_max=reals([state.max_decel_mps2 for state in states]),
        v_max=np.minimum(reals([state.max_speed_mps for state in states]), limit),
        movement=movement,
        lane=ground.lane[movement],
        footprint=np.array([vehicle.footprint for vehicle in present], dtype=np.int64),
        waited=np.maximum(time_s - reals([vehicle.entered_s for vehicle in present]), 0.0),
        assertiveness=reals([vehicle.priority.assertiveness for vehicle in present]),
        speed_priority=reals([vehicle.priority.speed for vehicle in present]),
        variation_priority=reals([vehicle.priority.variation for vehicle in present]),
        accepted=np.array(accepted, dtype=np.int64),
        silent=(age > silent_s) | np.array([vehicle.vanished for vehicle in present], dtype=np.bool_),
        age=age,
        stranger_x=reals([NEVER if each is None else each.gap_m - state.distance_m for each, state in strangers]),
        stranger_v=reals([0.0 if each is None else each.speed_mps for each, _ in strangers]),
        stranger_b=reals([1.0 if each is None else each.decel_mps2 for each, _ in strangers]),
        heard_s=np.where(age > 0.0, reals([state.distance_m for state in states]), s),
        heard_v=np.where(age > 0.0, reals([state.speed_mps for state in states]), v),
        gap=reals([math.inf if state.leader_gap_m is None else state.leader_gap_m for state in states]),
    )
