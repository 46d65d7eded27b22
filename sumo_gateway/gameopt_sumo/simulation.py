"""The running simulation: what vehicles sense and what they are told to do, step by step.

With `engine`, `readings` and `control` the only module that imports libsumo, which runs one simulation per process.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import libsumo

from gameopt_sumo import readings
from gameopt_sumo.control import Control
from gameopt_sumo.engine import Engine
from gameopt_sumo.figures import Measurements
from gameopt_sumo.layout import gap_before
from gameopt_sumo.meter import Meter
from gameopt_sumo.network import (
    DEFAULT_CONTROL_ZONE_M,
    Layout,
    NetworkError,
    read_layout,
    without_turn_speeds,
)
from gameopt_sumo.observation import EXIT_RANGE_M, STEP_S, Observation, Pose
from gameopt_sumo.radar import Body, Radar
from gameopt_sumo.readings import RADAR_BEYOND_EDGE_M
from gameopt_sumo.run_files import SimulationError, net_file_of, nominal_demand
from gameopt_sumo.whereabouts import Whereabouts, edge_of
from gameopt_wire import motion

HANDOVER_M = 30.0
"""From one junction to the next's control zone: the longest body has left the first, and its manager has heard so."""
CHANGE_M = 150.0
"""Where there are lanes to choose from, this much of the way is left to SUMO's driver to choose."""

__all__ = ["EXIT_RANGE_M", "STEP_S", "Observation", "Pose", "Simulation", "SimulationError"]


class Simulation:
    """A SUMO run and the vehicles round one of its junctions. Several may share one `engine`, and step in turns.

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
        inflate_m: float = 0.0,
        control: bool = True,
        measure: bool = True,
        control_zone_m: float = DEFAULT_CONTROL_ZONE_M,
        articulated: bool = False,
        engine: Engine | None = None,
    ) -> None:
        """Read the map and start SUMO, unless it runs; raises `SimulationError`, one line, for whatever is wrong."""
        config = Path(sumocfg)
        try:
            net = net_file_of(config, extra_args)
            self.layout: Layout = read_layout(net, junction, control_zone_m, articulated=articulated)
        except NetworkError as error:
            raise SimulationError(f"{config}: {error}") from None
        full_map = self.layout.map
        self.map = without_turn_speeds(full_map) if ignore_turn_speed else full_map
        self.flow_veh_h, self.ratio = nominal_demand(config, extra_args)
        self._radar = Radar(self.map)
        self._controlling = control
        self._about = Whereabouts(self.layout)
        self.engine = engine or Engine(config, seed, gui=gui, extra_args=extra_args)
        self._steps = self.engine.join()
        self._open = True
        self._control = Control(self.layout, self._about, self.engine.taken)
        if control:
            readings.take_over(self.map.intersection, self.layout.gates_mps)
        self.time_s = self.engine.time_s
        self._meter: Meter | None = None
        if measure:
            layout = dataclasses.replace(self.layout, map=self.map)
            outline = readings.outline(self.map.intersection)
            self._meter = Meter(layout, outline, self.time_s, readings.consumption_mg_s, inflate_m)

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the run, which ends with the last one; a second call does nothing."""
        if self._open:
            self._open = False
            self.engine.leave()

    def step(self) -> list[Observation]:
        """Advance by `STEP_S`; observe every vehicle from the control zone's entry to the end of the exit
        range.

        The order is the same in every run of one seed. Raises `SimulationError` when SUMO gives up.
        """
        self._steps += 1
        self.engine.step(self._steps)
        self.time_s = self.engine.time_s
        bodies = {body.vehicle: body for body in self._about.look()}
        leaders = self._radar.leaders(bodies.values())
        self._control.forget_absent(set(bodies))
        if self._controlling:
            self._steer(bodies, leaders)
        observations = [
            self._observe(body, leaders.get(body.vehicle), bodies)
            for body in bodies.values()
            if self._control.in_range(body)
        ]
        if self._meter is not None:
            self._measure(self._meter, observations)
        return observations

    def _steer(self, bodies: Mapping[str, Body], leaders: Mapping[str, tuple[str, float]]) -> None:
        """Everything that is done to vehicles beside setting speeds."""
        self._control.slow_down()
        for body in bodies.values():
            if body.wants or body.halts:
                self._control.hold_back(body)
            elif self._control.in_range(body):
                self._control.hand_over(body, leaders.get(body.vehicle))
            else:
                self._control.release(body.vehicle)

    def set_speed(self, vehicle: str, speed_mps: float) -> None:
        """The speed `vehicle` will have after the next step, reached at constant acceleration.

        Raises `SimulationError` if the vehicle is not controlled.
        """
        if not self.controls(vehicle):
            raise SimulationError(f"vehicle {vehicle!r} is not under control at {self.time_s:.1f} s")
        libsumo.vehicle.setSpeed(vehicle, max(0.0, speed_mps))

    def give_back_to(self, other: Layout) -> None:
        """Control ends before the zone of another junction begins; raises `SimulationError` where that is too near."""
        for lane in {movement.exit_lane for movement in self.map.movements}:
            gap_m = gap_before(other, lane)
            if gap_m is None:
                continue
            if gap_m < HANDOVER_M:
                raise SimulationError(
                    f"the control zone of junction {other.map.intersection!r} begins {max(0.0, gap_m):.0f} m behind "
                    f"{self.map.intersection!r} on lane {lane}; allowed: {HANDOVER_M:g} m or more"
                )
            alone = sum(edge_of(beside) == edge_of(lane) for beside in other.places) == 1
            self._control.ends_m[lane] = gap_m if alone else max(HANDOVER_M, gap_m - CHANGE_M)

    def controls(self, vehicle: str) -> bool:
        """Whether `set_speed` rules this vehicle now."""
        return self._control.controls(vehicle)

    def release(self, vehicle: str) -> None:
        """Hand a vehicle back to SUMO's car-following for good; nothing happens if it is not controlled."""
        self._control.release(vehicle)

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
            if self.layout.places[lane].kind in ("approach", "upstream") and not meter.knows(vehicle):
                meter.passing(readings.on_its_way(vehicle, self.time_s), self.time_s)
        meter.step(self.time_s, observations, self.poses())
        meter.faults(readings.collisions(self.layout.places), readings.teleports())

    def _observe(self, body: Body, leader: tuple[str, float] | None, bodies: Mapping[str, Body]) -> Observation:
        known = self._about.vehicles[body.vehicle]
        if self._controlling:
            self._control.take(known, body)
        assert body.movement is not None
        ahead = self._ahead(body, leader, bodies)
        return Observation(
            vehicle=body.vehicle,
            movement=self.map.movements[body.movement].id,
            distance_m=-body.past_line_m,
            speed_mps=readings.speed_mps(body.vehicle),
            acceleration_mps2=readings.acceleration_mps2(body.vehicle),
            length_m=known.length_m,
            width_m=known.width_m,
            vehicle_class=known.vehicle_class,
            max_speed_mps=min(known.max_speed_mps, self.layout.places[known.lane].limit_mps or known.max_speed_mps),
            max_accel_mps2=known.max_accel_mps2,
            max_decel_mps2=known.max_decel_mps2,
            leader_gap_m=ahead.gap_m if ahead else None,
            leader_speed_mps=ahead.speed_mps if ahead else None,
            leader_decel_mps2=ahead.decel_mps2 if ahead else None,
            leader_strange=ahead is not None and ahead.strange,
            controlled=known.controlled,
        )

    def _ahead(self, body: Body, leader: tuple[str, float] | None, bodies: Mapping[str, Body]) -> _Ahead | None:
        """What the radar sees: the leader, or the end of an exit where SUMO's driver has yet to take over."""
        assert body.movement is not None
        near_end_m = self.map.movements[body.movement].exit_length_m - RADAR_BEYOND_EDGE_M
        if leader is None and body.on_exit and body.exit_m > near_end_m:
            leader = readings.leader_beyond(body.vehicle)
        end_m = self._control.end_m(body)
        if end_m is not None and (leader is None or end_m + motion.REAR_GAP_M < leader[1]):
            return _Ahead(end_m + motion.REAR_GAP_M, 0.0, self._about.vehicles[body.vehicle].max_decel_mps2, True)
        if leader is None:
            return None
        vehicle, gap_m = leader
        strange = not self.controls(vehicle) or _elsewhere(body, bodies.get(vehicle))
        return _Ahead(gap_m, readings.speed_mps(vehicle), readings.decel_mps2(vehicle), strange)


def simulations(sumocfg: Path | str, junctions: Sequence[str | None], *given: Any, **named: Any) -> list[Simulation]:
    """One SUMO run, and what lies round each of several junctions; further arguments as for `Simulation`.

    A vehicle that drives from one to the other is given back where the other's control zone begins.
    Raises `SimulationError`, too, where that is nearer to the first than `HANDOVER_M`.
    """
    made: list[Simulation] = []
    try:
        for junction in junctions:
            engine = made[0].engine if made else None
            made.append(Simulation(sumocfg, junction, *given, engine=engine, **named))
        for first, second in permutations(made, 2):
            first.give_back_to(second.layout)
    except SimulationError:
        for one in made:
            one.close()
        raise
    return made


class _Ahead(NamedTuple):
    gap_m: float
    speed_mps: float
    decel_mps2: float
    strange: bool


def _elsewhere(body: Body, ahead: Body | None) -> bool:
    """Whether the vehicle ahead, not yet on the exit, is bound for another lane: its way is shared for a while only."""
    return ahead is not None and body.on_exit is None and ahead.on_exit is None and ahead.lane != body.lane
