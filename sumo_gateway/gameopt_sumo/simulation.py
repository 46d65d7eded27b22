"""The running simulation: what vehicles sense and what they are told to do, step by step.

With `readings` the only module that imports libsumo, which runs one simulation per process.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import libsumo

from gameopt_sumo import readings
from gameopt_sumo.figures import Measurements
from gameopt_sumo.meter import Meter
from gameopt_sumo.network import (
    DEFAULT_CONTROL_ZONE_M,
    Layout,
    NetworkError,
    read_layout,
    without_turn_speeds,
)
from gameopt_sumo.observation import EXIT_RANGE_M, STEP_S, Observation, Pose, Vehicle
from gameopt_sumo.radar import Body, Radar
from gameopt_sumo.readings import RADAR_BEYOND_EDGE_M, SUMO_FAULTS
from gameopt_sumo.run_files import Hush, SimulationError, net_file_of, nominal_demand
from gameopt_sumo.whereabouts import Whereabouts
from gameopt_wire import motion

__all__ = ["EXIT_RANGE_M", "STEP_S", "Observation", "Pose", "Simulation", "SimulationError"]

_SPEED_MODE_EXECUTE = 32
"""The set speed as it is: no car-following, no limits, no right of way before or within the junction."""
_LANE_CHANGE_NEVER = 0
_SPEED_MODE_SUMO = 31
_LANE_CHANGE_SUMO = 1621
GENTLE_DECEL_MPS2 = 2.0
"""A vehicle is slowed down at this to what the zone's limit allows."""


class Simulation:
    """One SUMO run and the vehicles round one of its junctions.

    With `control`, every vehicle is taken over when its front bumper enters the control zone: SUMO then
    executes exactly the speed that is set, with no car-following and no right of way of its own. A set speed
    stays until the next one, so the caller sets one for every controlled vehicle after every step. Past the
    exit range a vehicle is handed back by itself.
    """

    def __init__(
        self,
        sumocfg: Path | str,
        junction: str | None = None,
        seed: int = 1,
        *,
        gui: bool = False,
        extra_args: Sequence[str] = (),
        ignore_turn_speed: bool = False,
        control: bool = True,
        measure: bool = True,
        control_zone_m: float = DEFAULT_CONTROL_ZONE_M,
    ) -> None:
        """Read the map and start SUMO; raises `SimulationError`, one line, for whatever is wrong."""
        config = Path(sumocfg)
        try:
            self._layout: Layout = read_layout(net_file_of(config), junction, control_zone_m)
        except NetworkError as error:
            raise SimulationError(f"{config}: {error}") from None
        full_map = self._layout.map
        self.map = without_turn_speeds(full_map) if ignore_turn_speed else full_map
        self.flow_veh_h, self.ratio = nominal_demand(config, extra_args)
        self._radar = Radar(self.map)
        self._setback_m = max([0.0, *(back for movement in self.map.movements for back in movement.setback_m)])
        self._control = control
        self._about = Whereabouts(self._layout)
        self._open = False
        self._hush = Hush()
        try:
            readings.start(config, seed, gui, extra_args, self._hush)
        except SimulationError:
            self._hush.close()
            raise
        self._open = True
        if control:
            readings.take_over(self.map.intersection, self._layout.gates_mps)
        self.time_s: float = float(libsumo.simulation.getTime())
        self._meter: Meter | None = None
        if measure:
            layout = dataclasses.replace(self._layout, map=self.map)
            outline = readings.outline(self.map.intersection)
            self._meter = Meter(layout, outline, self.time_s, readings.consumption_mg_s)

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the run, which completes SUMO's output files; a second call does nothing."""
        if self._open:
            self._open = False
            with self._hush:
                libsumo.close()
            self._hush.close()

    def step(self) -> list[Observation]:
        """Advance by `STEP_S`; observe every vehicle from the control zone's entry to the end of the exit
        range.

        The order is the same in every run of one seed. Raises `SimulationError` when SUMO gives up.
        """
        try:
            with self._hush:
                libsumo.simulationStep()
        except SUMO_FAULTS as error:
            reason = self._hush.reason(str(error))
            raise SimulationError(f"SUMO stopped after {self.time_s:.1f} s: {reason}") from None
        self.time_s = float(libsumo.simulation.getTime())
        bodies = {body.vehicle: body for body in self._about.look()}
        self._forget_absent(set(bodies))
        self._slow_down()
        leaders = self._radar.leaders(bodies.values())
        observations = []
        for body in bodies.values():
            if self._in_range(body):
                observations.append(self._observe(body, leaders.get(body.vehicle), bodies))
            elif body.wants:
                self._hold_back(body)
            else:
                self.release(body.vehicle)
        if self._meter is not None:
            self._measure(self._meter, observations)
        return observations

    def set_speed(self, vehicle: str, speed_mps: float) -> None:
        """The speed `vehicle` will have after the next step, reached at constant acceleration.

        Raises `SimulationError` if the vehicle is not controlled.
        """
        if not self.controls(vehicle):
            raise SimulationError(f"vehicle {vehicle!r} is not under control at {self.time_s:.1f} s")
        libsumo.vehicle.setSpeed(vehicle, max(0.0, speed_mps))

    def controls(self, vehicle: str) -> bool:
        """Whether `set_speed` rules this vehicle now."""
        known = self._about.vehicles.get(vehicle)
        return known is not None and known.controlled

    def release(self, vehicle: str) -> None:
        """Hand a vehicle back to SUMO's car-following for good; nothing happens if it is not controlled."""
        known = self._about.vehicles.get(vehicle)
        if known is not None and known.controlled:
            known.controlled, known.released = False, True
            libsumo.vehicle.setSpeed(vehicle, -1.0)
            libsumo.vehicle.setSpeedMode(vehicle, _SPEED_MODE_SUMO)
            libsumo.vehicle.setLaneChangeMode(vehicle, _LANE_CHANGE_SUMO)

    def poses(self) -> list[Pose]:
        """Every vehicle on the junction and on its approach and exit edges, controlled or not."""
        return [readings.pose(vehicle, lane) for vehicle, lane in self._about.present]

    def measurements(self, warmup_s: float = 0.0) -> Measurements:
        """The figures of the run so far, without its first `warmup_s` (safety counts from the first step).

        Raises `SimulationError` if the run does not measure.
        """
        if self._meter is None:
            raise SimulationError("this simulation was started without measuring")
        return self._meter.measurements(self.time_s, warmup_s)

    @property
    def overlapping(self) -> list[tuple[str, str]]:
        """The pairs of vehicles whose bodies have overlapped so far, by the geometric check."""
        return self._meter.overlapping if self._meter else []

    def finished(self) -> bool:
        """Whether no vehicle is in the net and none is to come."""
        return int(libsumo.simulation.getMinExpectedNumber()) <= 0

    def _measure(self, meter: Meter, observations: Sequence[Observation]) -> None:
        meter.arrivals(self.time_s, readings.departed(), readings.pending(self.time_s, meter.knows))
        for vehicle, lane in self._about.present:
            if self._layout.places[lane].kind in ("approach", "upstream") and not meter.knows(vehicle):
                meter.passing(readings.on_its_way(vehicle, self.time_s), self.time_s)
        meter.step(self.time_s, observations, self.poses())
        meter.faults(readings.collisions(), readings.teleports())

    def _in_range(self, body: Body) -> bool:
        """Observed: on a movement, and not too far past the conflict zone."""
        if body.movement is None:
            return False
        return body.past_line_m <= self.map.movements[body.movement].length_m + EXIT_RANGE_M

    def _slow_down(self) -> None:
        """Whoever comes faster than the zone allows, by its own nature or from a faster road, brakes before it."""
        for vehicle, room_m, limit_mps in self._about.nearing if self._control else ():
            speed_mps = float(libsumo.vehicle.getSpeed(vehicle))
            if speed_mps > limit_mps:
                cap_mps = motion.brake_speed(room_m, speed_mps, GENTLE_DECEL_MPS2, STEP_S, limit_mps)
                libsumo.vehicle.setSpeed(vehicle, max(limit_mps, cap_mps))

    def _hold_back(self, body: Body) -> None:
        """A vehicle on a wrong lane is SUMO's, to change lanes; it may never come too near to stop before the line.

        Once it is on a right one it is taken over, and could not be if it could not stop.
        """
        known = self._about.vehicles[body.vehicle]
        if self._control:
            if known.controlled:
                self.release(body.vehicle)
                known.released = False
            room_m = -body.past_line_m - self._setback_m
            speed_mps = float(libsumo.vehicle.getSpeed(body.vehicle))
            limit_mps = motion.stop_speed(room_m, speed_mps, known.max_decel_mps2, STEP_S)
            libsumo.vehicle.setSpeed(body.vehicle, max(0.0, limit_mps))

    def _forget_absent(self, present: set[str]) -> None:
        """Vehicles that have left the junction's lanes go back to SUMO, if they are still driving."""
        absent = [vehicle for vehicle in self._about.vehicles if vehicle not in present]
        if absent:
            driving = set(libsumo.vehicle.getIDList())
            for vehicle in absent:
                if vehicle in driving:
                    self.release(vehicle)
                del self._about.vehicles[vehicle]

    def _observe(self, body: Body, leader: tuple[str, float] | None, bodies: Mapping[str, Body]) -> Observation:
        known = self._about.vehicles[body.vehicle]
        self._take(known, body)
        assert body.movement is not None
        movement = self.map.movements[body.movement]
        speed_mps = float(libsumo.vehicle.getSpeed(body.vehicle))
        if leader is None and body.on_exit and body.exit_m > movement.exit_length_m - RADAR_BEYOND_EDGE_M:
            leader = readings.leader_beyond(body.vehicle)
        ahead = leader[0] if leader else None
        return Observation(
            vehicle=body.vehicle,
            movement=movement.id,
            distance_m=-body.past_line_m,
            speed_mps=speed_mps,
            acceleration_mps2=float(libsumo.vehicle.getAcceleration(body.vehicle)),
            length_m=known.length_m,
            width_m=known.width_m,
            vehicle_class=known.vehicle_class,
            max_speed_mps=min(known.max_speed_mps, self._layout.places[known.lane].limit_mps or known.max_speed_mps),
            max_accel_mps2=known.max_accel_mps2,
            max_decel_mps2=known.max_decel_mps2,
            leader_gap_m=leader[1] if leader else None,
            leader_speed_mps=float(libsumo.vehicle.getSpeed(ahead)) if ahead else None,
            leader_decel_mps2=float(libsumo.vehicle.getDecel(ahead)) if ahead else None,
            leader_strange=ahead is not None and (not self.controls(ahead) or _elsewhere(body, bodies.get(ahead))),
            controlled=known.controlled,
        )

    def _take(self, known: Vehicle, body: Body) -> None:
        """Take a vehicle over the first time it is seen in the control zone."""
        if self._control and not known.controlled and not known.released and body.on_exit is None:
            known.controlled = True
            libsumo.vehicle.setSpeedMode(known.id, _SPEED_MODE_EXECUTE)
            libsumo.vehicle.setLaneChangeMode(known.id, _LANE_CHANGE_NEVER)


def _elsewhere(body: Body, ahead: Body | None) -> bool:
    """Whether the vehicle ahead, not yet on the exit, is bound for another lane: its way is shared for a while only."""
    return ahead is not None and body.on_exit is None and ahead.on_exit is None and ahead.lane != body.lane
