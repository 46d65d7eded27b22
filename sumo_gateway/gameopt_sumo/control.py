"""Who drives: vehicles taken over from SUMO's driver model, held back or slowed down in it, and given back to it.

With `engine`, `simulation` and `readings` the only module that imports libsumo.
"""

from __future__ import annotations

import libsumo

from gameopt_sumo import readings
from gameopt_sumo.areas import ARTICULATED
from gameopt_sumo.layout import Layout
from gameopt_sumo.observation import EXIT_RANGE_M, STEP_S, Vehicle
from gameopt_sumo.radar import Body
from gameopt_sumo.run_files import SimulationError
from gameopt_sumo.whereabouts import Whereabouts
from gameopt_wire import motion
from gameopt_wire.intersection import Footprint

_SPEED_MODE_EXECUTE = 32
"""The set speed as it is: no car-following, no limits, no right of way before or within the junction."""
_LANE_CHANGE_NEVER = 0
_SPEED_MODE_SUMO = 31
_LANE_CHANGE_SUMO = 1621

GENTLE_DECEL_MPS2 = 2.0
"""A vehicle is slowed down at this to what the zone's limit allows."""
HANDOVER_S = 2.0
"""SUMO's driver gets this long before it has to brake for the junction after the exit."""
STOP_SLACK_M = 0.5
"""A stop near the line is made this far before where vehicles are held back, so that SUMO's driver does reach it."""
SAFE_HEADWAY_S = 1.3
SAFE_GAP_M = 2.5
"""At this gap, with this headway on top, SUMO's driver can take a vehicle over without braking hard."""


class Control:
    """What is done to SUMO's vehicles, apart from setting speeds.

    `taken` are those that this or another junction has taken over: the others' are left alone.
    """

    def __init__(self, layout: Layout, about: Whereabouts, taken: set[str]) -> None:
        self._layout = layout
        self._about = about
        self._places = layout.places
        self._movements = layout.map.movements
        self._taken = taken
        self.ends_m: dict[str, float] = {}
        """Exit lanes on which another junction takes over, and from where, m."""
        self._setback_m = max([0.0, *(back for movement in self._movements for back in movement.setback_m)])

    def take(self, known: Vehicle, body: Body) -> None:
        """Take a vehicle over the first time it is seen in the control zone.

        Raises `SimulationError` for one whose ground nobody knows.
        """
        if not known.controlled and not known.released and body.on_exit is None and known.id not in self._taken:
            self._check_size(known)
            known.controlled = True
            self._taken.add(known.id)
            known.route_id, known.route = readings.route_id(known.id), readings.route_ahead(known.id)
            known.rerouting_period = readings.set_rerouting_period(known.id, "0")
            libsumo.vehicle.setSpeedMode(known.id, _SPEED_MODE_EXECUTE)
            libsumo.vehicle.setLaneChangeMode(known.id, _LANE_CHANGE_NEVER)

    def _check_size(self, known: Vehicle) -> None:
        bodies = self._layout.map.footprints
        if not self._layout.map.covers(known.length_m, known.width_m):
            more = "" if ARTICULATED in bodies else f"; up to {_size(ARTICULATED)} with --articulated on both sides"
            raise SimulationError(
                f"vehicle {known.id!r} is {_size(known)}; allowed at {self._layout.map.intersection!r}: "
                f"up to {_size(bodies[-1])}{more}"
            )

    def controls(self, vehicle: str) -> bool:
        """Whether a vehicle is taken over."""
        known = self._about.vehicles.get(vehicle)
        return known is not None and known.controlled

    def release(self, vehicle: str, for_good: bool = True) -> None:
        """Hand a vehicle back to SUMO's car-following; nothing happens if it is not controlled."""
        known = self._about.vehicles.get(vehicle)
        if known is not None and known.controlled:
            known.controlled, known.released = False, for_good
            self._taken.discard(vehicle)
            if known.rerouting_period is not None:
                readings.set_rerouting_period(vehicle, known.rerouting_period)
            libsumo.vehicle.setSpeed(vehicle, -1.0)
            libsumo.vehicle.setSpeedMode(vehicle, _SPEED_MODE_SUMO)
            libsumo.vehicle.setLaneChangeMode(vehicle, _LANE_CHANGE_SUMO)

    def forget_absent(self, present: set[str]) -> None:
        """Vehicles that have left the junction's lanes go back to SUMO, if they are still driving."""
        absent = [vehicle for vehicle in self._about.vehicles if vehicle not in present]
        if absent:
            driving = set(libsumo.vehicle.getIDList())
            for vehicle in absent:
                if vehicle in driving:
                    self.release(vehicle)
                elif self.controls(vehicle):
                    self._taken.discard(vehicle)
                del self._about.vehicles[vehicle]

    def in_range(self, body: Body) -> bool:
        """Observed: on a movement, not too far past the conflict zone, and not in the next junction's control zone."""
        if body.movement is None or (body.on_exit in self.ends_m and body.exit_m >= self.ends_m[body.on_exit]):
            return False
        return body.past_line_m <= self._movements[body.movement].length_m + EXIT_RANGE_M

    def slow_down(self) -> None:
        """Whoever comes faster than the zone allows, by its own nature or from a faster road, brakes before it."""
        for vehicle, room_m, limit_mps in self._about.nearing:
            if vehicle in self._taken:
                continue
            speed_mps = readings.speed_mps(vehicle)
            if speed_mps > limit_mps:
                cap_mps = motion.brake_speed(room_m, speed_mps, GENTLE_DECEL_MPS2, STEP_S, limit_mps)
                libsumo.vehicle.setSpeed(vehicle, max(limit_mps, cap_mps))

    def hold_back(self, body: Body) -> None:
        """A vehicle on a wrong lane is SUMO's, to change it, and one with a stop planned before the line, to make it.

        It may never come too near to stop before the line: once it is ready it is taken over, and could not be then.
        """
        if body.vehicle in self._taken and not self.controls(body.vehicle):
            return  # another junction's, which gives it back before this one needs it
        self.release(body.vehicle, for_good=False)
        if body.halts:
            self._stop_in_time(body.vehicle)
        known = self._about.vehicles[body.vehicle]
        room_m = -body.past_line_m - self._setback_m
        limit_mps = motion.stop_speed(room_m, readings.speed_mps(body.vehicle), known.max_decel_mps2, STEP_S)
        libsumo.vehicle.setSpeed(body.vehicle, max(0.0, limit_mps))

    def _stop_in_time(self, vehicle: str) -> None:
        """A stop planned nearer to the line than anybody may come is made where vehicles are held back."""
        stop = readings.next_stop(vehicle)
        if stop is None or self._places[stop.lane].kind != "approach":
            return
        end_m = -self._places[stop.lane].offset_m - self._setback_m - motion.STOP_OFFSET_M - STOP_SLACK_M
        if stop.start_m > end_m > 0.0:
            readings.stop_sooner(vehicle, end_m)

    def hand_over(self, body: Body, leader: tuple[str, float] | None) -> None:
        """Give a vehicle back in time for the junction at the end of its exit, once its gap is safe for that."""
        if (end_m := self.end_m(body)) is None or not self.controls(body.vehicle):
            return
        speed_mps = readings.speed_mps(body.vehicle)
        near = end_m <= HANDOVER_S * speed_mps + 0.5 * speed_mps**2 / motion.TURN_DECEL_MPS2 + SAFE_GAP_M
        if near and (leader is None or leader[1] >= SAFE_GAP_M + SAFE_HEADWAY_S * speed_mps):
            self.release(body.vehicle)

    def end_m(self, body: Body) -> float | None:
        """How far the front is from where SUMO's driver has to brake on the exit; None while its tail is inside.

        That is the end of an exit where it has to yield, or a stop it has planned. Until it has been given back it
        keeps clear of that as of a standing vehicle.
        """
        if body.on_exit is None or body.movement is None:
            return None
        if body.past_line_m - body.length_m < self._movements[body.movement].clear_m:
            return None
        stop_m = self._about.vehicles[body.vehicle].stop_m
        ends = [] if stop_m is None else [stop_m]
        reach_m = self._places[body.on_exit].yields_m
        if reach_m is not None and len(readings.route_ahead(body.vehicle)) >= 2:
            ends.append(reach_m)
        return min(ends) - body.exit_m if ends else None


def _size(body: Footprint | Vehicle) -> str:
    return f"{body.length_m:g} m by {body.width_m:g} m"
