"""Single calls to libsumo: starting it, and reading a vehicle's values."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Container, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import libsumo

from gameopt_sumo.observation import Departure, Pose, Vehicle
from gameopt_sumo.run_files import Hush, SimulationError, sumo_arguments

SUMO_FAULTS = (libsumo.TraCIException, libsumo.FatalTraCIError)
RADAR_BEYOND_EDGE_M = 100.0
"""How far beyond the end of the exit edge a leader is looked for."""

STOP_LENGTH_M = 1.0
_REROUTING_PERIOD = "device.rerouting.period"
_AS_LONG = 1 | 2 | 4
"""Beside the road, until somebody gets in, until something is loaded; the other flags name a stopping place."""


class Stop(NamedTuple):
    """Where a stop is planned: its lane, and the stretch of it where the front may be."""

    lane: str
    start_m: float
    end_m: float


def start(config: Path, seed: int, gui: bool, extra_args: Sequence[str], hush: Hush) -> None:
    """Start SUMO on `config` with the enforced options. Raises `SimulationError`."""
    command = ["sumo-gui", "--start", "--quit-on-end"] if gui else ["sumo"]
    command += sumo_arguments(config, seed, extra_args)
    if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # Without a display the window library ends the whole process.
        raise SimulationError("--gui: there is no display (DISPLAY is not set); run without --gui")
    try:
        with hush:
            libsumo.start(command)
    except SUMO_FAULTS as error:
        raise SimulationError(f"{config}: {hush.reason(str(error))}") from None


def advance(until_s: float, hush: Hush) -> None:
    """Let SUMO alone make all the steps up to a time. Raises `SimulationError`."""
    try:
        with hush:
            libsumo.simulationStep(until_s)
    except SUMO_FAULTS as error:
        raise SimulationError(f"SUMO stopped before {until_s:.1f} s: {hush.reason(str(error))}") from None


def end(hush: Hush) -> None:
    """End the run."""
    with hush:
        libsumo.close()


def take_over(junction: str, gates_mps: Mapping[str, float]) -> None:
    """Switch the lights of the junction off, if they serve no other, and slow down who comes into a short zone."""
    api = libsumo.trafficlight
    for light in api.getIDList():
        if set(api.getControlledJunctions(light)) == {junction}:
            api.setProgram(light, "off")
    for lane, speed_mps in gates_mps.items():
        libsumo.lane.setMaxSpeed(lane, min(speed_mps, float(libsumo.lane.getMaxSpeed(lane))))


def leader_beyond(vehicle: str) -> tuple[str, float] | None:
    """The leader on the edges after the exit edge; SUMO counts its gap less the follower's minimum gap."""
    found = libsumo.vehicle.getLeader(vehicle, RADAR_BEYOND_EDGE_M)
    if not found or not found[0]:
        return None
    return found[0], float(found[1] + libsumo.vehicle.getMinGap(vehicle))


def read_vehicle(vehicle: str) -> Vehicle:
    """What the vehicle's type says."""
    api = libsumo.vehicle
    return Vehicle(
        id=vehicle,
        length_m=float(api.getLength(vehicle)),
        width_m=float(api.getWidth(vehicle)),
        vehicle_class=str(api.getVehicleClass(vehicle)),
        max_speed_mps=float(api.getMaxSpeed(vehicle)),
        max_accel_mps2=float(api.getAccel(vehicle)),
        max_decel_mps2=float(api.getDecel(vehicle)),
    )


def next_stop(vehicle: str) -> Stop | None:
    """The next stop that a vehicle has planned, or is making; None without one."""
    stops = libsumo.vehicle.getStops(vehicle, 1)
    if not stops:
        return None
    return Stop(str(stops[0].lane), float(stops[0].startPos), float(stops[0].endPos))


def stop_sooner(vehicle: str, end_m: float) -> None:
    """Let the vehicle make its next stop at a place further up its lane, for as long as it would have."""
    stop = libsumo.vehicle.getStops(vehicle, 1)[0]
    edge, _, lane = stop.lane.rpartition("_")
    start_m = max(0.0, end_m - STOP_LENGTH_M)
    kept = stop.stopFlags & _AS_LONG
    libsumo.vehicle.replaceStop(vehicle, 0, edge, end_m, int(lane), stop.duration, kept, start_m, stop.until)


def vehicles_on(lane: str) -> tuple[str, ...]:
    """The vehicles with their front on a lane, upstream first."""
    return tuple(libsumo.lane.getLastStepVehicleIDs(lane))


def count_on(lane: str) -> int:
    """How many vehicles have their front on a lane."""
    return int(libsumo.lane.getLastStepVehicleNumber(lane))


def count_pending() -> int:
    """How many vehicles whose time has come find no room on the road."""
    return len(libsumo.simulation.getPendingVehicles())


def position_m(vehicle: str) -> float:
    """How far along its lane the front is."""
    return float(libsumo.vehicle.getLanePosition(vehicle))


def speed_mps(vehicle: str) -> float:
    """Its speed."""
    return float(libsumo.vehicle.getSpeed(vehicle))


def acceleration_mps2(vehicle: str) -> float:
    """Its acceleration in the last step."""
    return float(libsumo.vehicle.getAcceleration(vehicle))


def decel_mps2(vehicle: str) -> float:
    """The deceleration of its type."""
    return float(libsumo.vehicle.getDecel(vehicle))


def route_id(vehicle: str) -> str:
    """The id of its route: another one as soon as it has been given another."""
    return str(libsumo.vehicle.getRouteID(vehicle))


def set_route(vehicle: str, edges: Sequence[str]) -> bool:
    """Give it a route that begins with the edge it is on; False where a road on it is closed."""
    try:
        libsumo.vehicle.setRoute(vehicle, list(edges))
    except libsumo.TraCIException:
        return False
    return True


def set_rerouting_period(vehicle: str, period: str) -> str | None:
    """How often SUMO looks for a better route for it, s, "0" for never; what it was, None where it never does."""
    api = libsumo.vehicle
    if api.getParameter(vehicle, "has.rerouting.device") != "true":
        return None
    before = str(api.getParameter(vehicle, _REROUTING_PERIOD))
    api.setParameter(vehicle, _REROUTING_PERIOD, period)
    return before


def route_ahead(vehicle: str) -> tuple[str, ...]:
    """The edges of its route, from the one it is on."""
    return tuple(libsumo.vehicle.getRoute(vehicle)[max(0, libsumo.vehicle.getRouteIndex(vehicle)) :])


def vias_ahead(vehicle: str) -> tuple[str, ...]:
    """The first lanes within the junctions ahead, as far as its lane leads along its route."""
    return tuple(link[4] for link in libsumo.vehicle.getNextLinks(vehicle))


def pose(vehicle: str, lane: str) -> Pose:
    """Where the vehicle stands."""
    api = libsumo.vehicle
    x_m, y_m = api.getPosition(vehicle)
    return Pose(
        vehicle=vehicle,
        x_m=float(x_m),
        y_m=float(y_m),
        angle_deg=float(api.getAngle(vehicle)),
        length_m=float(api.getLength(vehicle)),
        width_m=float(api.getWidth(vehicle)),
        speed_mps=float(api.getSpeed(vehicle)),
        lane=lane,
    )


def departed() -> list[Departure]:
    """The vehicles inserted in the last step."""
    api = libsumo.vehicle
    return [
        on_its_way(vehicle, float(api.getDeparture(vehicle) - api.getDepartDelay(vehicle)))
        for vehicle in libsumo.simulation.getDepartedIDList()
    ]


def pending(time_s: float, known: Callable[[str], bool]) -> list[Departure]:
    """The vehicles whose time has come and that find no room on the road, but for those already known."""
    api = libsumo.vehicle
    return [
        Departure(vehicle, time_s, tuple(api.getRoute(vehicle)), 0.0, float(api.getMaxSpeed(vehicle)))
        for vehicle in libsumo.simulation.getPendingVehicles()
        if not known(vehicle)
    ]


def on_its_way(vehicle: str, scheduled_s: float) -> Departure:
    """A driving vehicle, its route from where it is."""
    api = libsumo.vehicle
    return Departure(
        id=vehicle,
        scheduled_s=scheduled_s,
        route=route_ahead(vehicle),
        position_m=float(api.getLanePosition(vehicle)),
        max_speed_mps=float(api.getMaxSpeed(vehicle)),
    )


def consumption_mg_s(vehicle: str) -> tuple[float, float]:
    """Fuel and CO2 of the last step, mg/s."""
    api = libsumo.vehicle
    return float(api.getFuelConsumption(vehicle)), float(api.getCO2Emission(vehicle))


def collisions(lanes: Container[str]) -> list[tuple[str, str]]:
    """The pairs SUMO itself found colliding on these lanes in the last step."""
    found = libsumo.simulation.getCollisions()
    return [(pair.collider, pair.victim) for pair in found if pair.lane in lanes]


def teleports() -> int:
    """How many vehicles SUMO began to teleport in the last step."""
    return int(libsumo.simulation.getStartingTeleportNumber())


def outline(junction: str) -> list[tuple[float, float]]:
    """The ground of a junction, in net coordinates."""
    return [(float(x), float(y)) for x, y in libsumo.junction.getShape(junction)]
