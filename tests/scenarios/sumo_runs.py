"""Runs for `test_sumo_simulation`, each in a process of its own: libsumo has one simulation per process."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import numpy as np

from gameopt_sumo.junction import read_net
from gameopt_sumo.simulation import STEP_S, Observation, Simulation, SimulationError, simulations
from gameopt_wire import motion


def at_limits(simulation: Simulation, seen: Observation) -> float:
    """The speed of a driver who keeps to the limits and to his own abilities, and looks at nobody."""
    movement = next(m for m in simulation.map.movements if m.id == seen.movement)
    turn_mps = movement.turn_speed_mps or 20.0
    wanted = 20.0
    if seen.distance_m > 0.0:
        wanted = min(20.0, math.sqrt(turn_mps**2 + 6.0 * max(0.0, seen.distance_m - 0.1 * seen.speed_mps)))
    elif -seen.distance_m < movement.length_m:
        wanted = turn_mps
    return max(min(wanted, seen.speed_mps + 0.1 * seen.max_accel_mps2), seen.speed_mps - 0.45)


def behind_its_leader(simulation: Simulation, seen: Observation) -> float:
    """The speed of one who also keeps rule 2 by his radar."""
    speed = at_limits(simulation, seen)
    if seen.leader_gap_m is not None and seen.leader_speed_mps is not None:
        gap_m, b = seen.leader_gap_m - motion.REAR_GAP_M, seen.max_decel_mps2
        lead_b = seen.leader_decel_mps2 or b
        speed = min(speed, motion.follow_speed(gap_m, seen.speed_mps, b, seen.leader_speed_mps, lead_b, STEP_S))
    return max(speed, seen.speed_mps - seen.max_decel_mps2 * STEP_S, 0.0)


def set_speeds(sumocfg: Path) -> dict[str, Any]:
    """Random speeds for everybody, also beyond their abilities; the largest deviations in what SUMO did."""
    choice = random.Random(5)
    off_speed = off_way = 0.0
    checked = 0
    stretches: set[str] = set()
    with Simulation(sumocfg, measure=False) as simulation:
        told: dict[str, tuple[float, float, float]] = {}
        for _ in range(600):
            now = simulation.step()
            for seen in now:
                if seen.vehicle in told:
                    distance_m, speed_mps, wanted = told[seen.vehicle]
                    off_speed = max(off_speed, abs(seen.speed_mps - wanted))
                    way = distance_m - seen.distance_m
                    off_way = max(off_way, abs(way - 0.05 * (speed_mps + wanted)))
                    checked += 1
                    place = "exit" if seen.distance_m < -30.0 else "in" if seen.distance_m < 0.0 else "approach"
                    stretches.add(place)
            told = {}
            for seen in now:
                if seen.controlled:
                    wanted = min(24.0, max(0.0, seen.speed_mps + choice.uniform(-0.6, 0.6)))
                    if choice.random() < 0.01:
                        wanted = max(0.0, seen.speed_mps - 3.0)
                    simulation.set_speed(seen.vehicle, wanted)
                    told[seen.vehicle] = (seen.distance_m, seen.speed_mps, wanted)
    return {"off_speed": off_speed, "off_way": off_way, "checked": checked, "stretches": sorted(stretches)}


def poses_on_the_map(sumocfg: Path, net: Path) -> dict[str, Any]:
    """How far SUMO's poses are from the chord on the net's centre lines, driving over the junction."""
    import shapely

    lanes = read_net(net)
    off_m = off_deg = 0.0
    checked = 0
    with Simulation(sumocfg, measure=False) as simulation:
        movements = {m.id: m for m in simulation.map.movements}
        lines = {}
        for name, movement in movements.items():
            before = lanes.getLane(simulation.map.lanes[movement.lane].id).getShape()
            after = lanes.getLane(movement.exit_lane).getShape()
            line_m = shapely.LineString(before).length
            lines[name] = (shapely.LineString([*before, *movement.path, *after]), line_m)
        for _ in range(900):
            observed = {seen.vehicle: seen for seen in simulation.step()}
            for pose in simulation.poses():
                seen = observed.get(pose.vehicle)
                if seen is None or abs(seen.distance_m) > 40.0:
                    continue
                line, line_m = lines[seen.movement]
                front = line.interpolate(line_m - seen.distance_m)
                rear = line.interpolate(line_m - seen.distance_m - seen.length_m)
                off_m = max(off_m, front.distance(shapely.Point(pose.x_m, pose.y_m)))
                angle = math.degrees(math.atan2(front.x - rear.x, front.y - rear.y))
                off_deg = max(off_deg, abs((angle - pose.angle_deg + 180.0) % 360.0 - 180.0))
                checked += 1
            for seen in observed.values():
                if seen.controlled:
                    simulation.set_speed(seen.vehicle, at_limits(simulation, seen))
    return {"off_m": off_m, "off_deg": off_deg, "checked": checked}


def nobody_yields(sumocfg: Path, steps: int, warmup_s: float) -> dict[str, Any]:
    """Everybody drives at the limits and nobody looks: the measurements, and a hash of the whole run."""
    import hashlib

    import msgspec

    digest = hashlib.sha256()
    with Simulation(sumocfg, seed=3) as simulation:
        for _ in range(steps):
            for seen in simulation.step():
                digest.update(repr(seen).encode())
                if seen.controlled:
                    simulation.set_speed(seen.vehicle, at_limits(simulation, seen))
        found = simulation.measurements(warmup_s)
    return {**msgspec.to_builtins(found), "digest": digest.hexdigest()}


def sumo_drives(sumocfg: Path, steps: int) -> dict[str, Any]:
    """SUMO's own drivers, only watched."""
    import msgspec

    with Simulation(sumocfg, control=False) as simulation:
        controlled = sum(seen.controlled for _ in range(steps) for seen in simulation.step())
        return {**msgspec.to_builtins(simulation.measurements(10.0)), "controlled": controlled}


def release_and_close(sumocfg: Path, fcd: Path) -> dict[str, Any]:
    """One vehicle is released inside the zone, the others beyond the exit range."""
    simulation = Simulation(sumocfg, extra_args=["--fcd-output", str(fcd)])
    furthest, released, refused = 0.0, "", ""
    for _ in range(1500):
        for seen in simulation.step():
            if seen.controlled:
                furthest = min(furthest, seen.distance_m)
                if not released and seen.distance_m < -40.0:
                    released = seen.vehicle
                    simulation.release(released)
                    try:
                        simulation.set_speed(released, 5.0)
                    except SimulationError as error:
                        refused = str(error)
                else:
                    simulation.set_speed(seen.vehicle, at_limits(simulation, seen))
            elif seen.vehicle == released:
                assert not simulation.controls(released)
    time_s = simulation.time_s
    simulation.close()
    simulation.close()
    return {"furthest_m": furthest, "refused": refused, "time_s": time_s, "fcd": fcd.stat().st_size}


def last_seen(sumocfg: Path, net: Path, junction: str, steps: int) -> dict[str, Any]:
    """Everybody drives at the limits, behind its leader; who was still controlled when last seen before the next."""
    beyond = {edge.getID(): edge.getToNode().getType() for edge in read_net(net).getEdges()}
    seen_last: dict[str, Observation] = {}
    present: set[str] = set()
    with Simulation(sumocfg, junction, measure=False) as simulation:
        for _ in range(steps):
            now = simulation.step()
            present = {seen.vehicle for seen in now}
            for seen in now:
                seen_last[seen.vehicle] = seen
                if seen.controlled:
                    simulation.set_speed(seen.vehicle, behind_its_leader(simulation, seen))
        exits = {movement.id: movement.exit_lane.rpartition("_")[0] for movement in simulation.map.movements}
    gone = [
        seen
        for vehicle, seen in seen_last.items()
        if vehicle not in present and beyond[exits[seen.movement]] == "traffic_light"
    ]
    return {"gone": len(gone), "controlled": sorted(seen.vehicle for seen in gone if seen.controlled)}


def by_both(sumocfg: Path, junctions: tuple[str, ...], steps: int) -> dict[str, Any] | str:
    """Two junctions on one road: who was in the hands of both at once, and how long in nobody's in between, s."""
    held: list[dict[str, list[float]]] = [{} for _ in junctions]
    at_once: list[str] = []
    try:
        roads = simulations(sumocfg, junctions, measure=False)
    except SimulationError as error:
        return str(error)
    for _ in range(steps):
        now = [[seen for seen in road.step() if seen.controlled] for road in roads]
        at_once += {seen.vehicle for seen in now[0]} & {seen.vehicle for seen in now[1]}
        for road, controlled, times in zip(roads, now, held, strict=True):
            for seen in controlled:
                times.setdefault(seen.vehicle, []).append(road.time_s)
                road.set_speed(seen.vehicle, behind_its_leader(road, seen))
    for road in roads:
        road.close()
    first, second = held
    spans = [sorted((first[v], second[v])) for v in first.keys() & second.keys()]
    return {"at_once": at_once, "gaps_s": [later[0] - earlier[-1] for earlier, later in spans]}


def fails(sumocfg: Path, junction: str | None = None, extra: tuple[str, ...] = (), gui: bool = False) -> str:
    """The message of a simulation that cannot start."""
    try:
        Simulation(sumocfg, junction, extra_args=extra, gui=gui).close()
    except SimulationError as error:
        return str(error)
    return "started"


def rerouting_periods(sumocfg: Path, period: str) -> dict[str, list[str]]:
    """How often SUMO looks for better routes for those who are taken over, and for the others, s."""
    import libsumo

    options = ("--device.rerouting.probability", "1", "--device.rerouting.period", period)
    found: dict[str, set[str]] = {"controlled": set(), "others": set()}
    with Simulation(sumocfg, extra_args=options, measure=False) as simulation:
        for _ in range(1200):
            for seen in simulation.step():
                if seen.controlled:
                    simulation.set_speed(seen.vehicle, at_limits(simulation, seen))
            for vehicle in libsumo.vehicle.getIDList():
                who = "controlled" if simulation.controls(vehicle) else "others"
                found[who].add(libsumo.vehicle.getParameter(vehicle, "device.rerouting.period"))
    return {who: sorted(periods) for who, periods in found.items()}


def too_large(sumocfg: Path, junction: str) -> str:
    """What the simulation says of the first vehicle that its map does not cover."""
    with Simulation(sumocfg, junction, measure=False) as simulation:
        try:
            for _ in range(3000):
                for seen in simulation.step():
                    if seen.controlled:
                        simulation.set_speed(seen.vehicle, behind_its_leader(simulation, seen))
        except SimulationError as error:
            return str(error)
    return "nobody is too large"


def check_costs(sumocfg: Path) -> float:
    """Median time of the geometric check per step with 50 to 100 vehicles about, ms."""
    from time import perf_counter

    from gameopt_sumo.collisions import OverlapCheck

    check, times = OverlapCheck(), []
    with Simulation(sumocfg, measure=False, control=False) as simulation:
        for _ in range(900):
            simulation.step()
            poses = simulation.poses()
            start = perf_counter()
            check.step(poses)
            if len(poses) >= 50:
                times.append((perf_counter() - start) * 1000.0)
    return float(np.median(times))
