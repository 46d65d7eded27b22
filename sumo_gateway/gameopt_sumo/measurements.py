"""Accumulates what the report says of a run, from what the simulator shows and from nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gameopt_sumo.figures import (
    ClassFigures,
    Measurements,
    Safety,
    TimeLoss,
    TimeToGoal,
    VehicleCounts,
)
from gameopt_sumo.observation import STEP_S, Observation
from gameopt_wire.intersection import IntersectionMap, Movement

HARD_BRAKE_MPS2 = 4.0
COMFORTABLE_DECEL_MPS2 = 3.0
"""A lone vehicle slows for its turn at this, or at its own deceleration if that is less."""
_TOLERANCE_MPS2 = 1e-6


@dataclass(slots=True)
class _Trip:
    """One vehicle's way over the junction; times in s, masses in mg."""

    vehicle_class: str
    entered_s: float
    free_flow_s: float
    distance_m: float
    fuel_mg: float = 0.0
    co2_mg: float = 0.0
    crossed_s: float | None = None
    braking_hard: bool = False


class Recorder:
    """One run's record. The warm-up may be named at the end: everything is kept with its time."""

    def __init__(
        self, intersection_map: IntersectionMap, consumption_mg_s: Callable[[str], tuple[float, float]]
    ) -> None:
        """`consumption_mg_s` gives a vehicle's fuel and CO2 of the last step."""
        self._map = intersection_map
        self._movements = {movement.id: movement for movement in intersection_map.movements}
        self._consumption_mg_s = consumption_mg_s
        self._due_s: dict[str, float] = {}
        self._trips: dict[str, _Trip] = {}
        self._collided: set[frozenset[str]] = set()
        self._hard_brakes = 0
        self._teleports = 0

    def due(self, vehicle: str, time_s: float) -> None:
        """When `vehicle` would reach the control zone on a free road; the last word counts."""
        self._due_s[vehicle] = time_s

    def collided(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Pairs the simulator found colliding."""
        self._collided.update(frozenset(pair) for pair in pairs)

    def teleported(self, count: int) -> None:
        """Vehicles the simulator took off the road."""
        self._teleports += count

    def step(self, time_s: float, observations: Sequence[Observation]) -> None:
        """What every vehicle from the control zone's entry on does at `time_s`."""
        for seen in observations:
            trip = self._trips.get(seen.vehicle)
            if trip is None:
                trip = self._trips[seen.vehicle] = self._enter(time_s, seen)
                self._advance(trip, seen, time_s, since_s=trip.entered_s)
            else:
                self._advance(trip, seen, time_s, since_s=time_s - STEP_S)
            hard = seen.acceleration_mps2 < -HARD_BRAKE_MPS2 - _TOLERANCE_MPS2
            if hard and not trip.braking_hard:
                self._hard_brakes += 1
            trip.braking_hard = hard

    def _enter(self, time_s: float, seen: Observation) -> _Trip:
        movement = self._movements[seen.movement]
        lane = self._map.lanes[movement.lane]
        mean_mps = seen.speed_mps - 0.5 * seen.acceleration_mps2 * STEP_S
        inside_m = lane.zone_m - seen.distance_m
        since_s = min(STEP_S, inside_m / mean_mps) if mean_mps > 0.0 else 0.0
        # One that departs inside the zone has the rest of it before it.
        way_m = lane.zone_m if inside_m <= mean_mps * STEP_S else seen.distance_m + mean_mps * since_s
        free_flow_s = free_flow_time_s(
            movement, way_m, min(lane.speed_limit_mps, seen.max_speed_mps), seen.max_decel_mps2
        )
        return _Trip(seen.vehicle_class, time_s - max(0.0, since_s), free_flow_s, way_m)

    def _advance(self, trip: _Trip, seen: Observation, time_s: float, since_s: float) -> None:
        """Book the time from `since_s` on, up to the instant the front bumper comes onto the exit lane."""
        if trip.crossed_s is not None:
            return
        until_s = time_s
        goal_m = -self._movements[seen.movement].length_m
        if seen.distance_m <= goal_m:
            way_m = trip.distance_m - seen.distance_m
            share = (trip.distance_m - goal_m) / way_m if way_m > 0.0 else 1.0
            until_s = trip.crossed_s = since_s + share * (time_s - since_s)
        fuel, co2 = self._consumption_mg_s(seen.vehicle)
        trip.fuel_mg += fuel * (until_s - since_s)
        trip.co2_mg += co2 * (until_s - since_s)
        trip.distance_m = seen.distance_m

    def measurements(self, from_s: float, until_s: float, overlaps: int, least_pet_s: float | None) -> Measurements:
        """The figures of the measuring window; `overlaps` and `least_pet_s` are geometry\'s."""
        entered = [trip for trip in self._trips.values() if trip.entered_s >= from_s]
        crossed = [trip for trip in entered if trip.crossed_s is not None]
        waiting = sum(due <= until_s for v, due in self._due_s.items() if v not in self._trips)
        crossings = sum(t.crossed_s is not None and t.crossed_s >= from_s for t in self._trips.values())
        minutes = (until_s - from_s) / 60.0
        times = [_time_to_goal_s(t) for t in crossed]
        losses = [_time_to_goal_s(t) - t.free_flow_s for t in crossed]
        return Measurements(
            vehicles=VehicleCounts(
                arrived=len(entered) + waiting,
                entered=len(entered),
                crossed=len(crossed),
                in_zone=len(entered) - len(crossed),
                waiting_to_enter=waiting,
            ),
            throughput_veh_min=crossings / minutes if minutes > 0.0 else None,
            time_to_goal_s=TimeToGoal(
                mean=_mean(times),
                p50=_percentile(times, 50),
                p95=_percentile(times, 95),
                max=_percentile(times, 100),
            ),
            time_loss_s=TimeLoss(mean=_mean(losses), p95=_percentile(losses, 95), max=_percentile(losses, 100)),
            fuel_g=_mean([t.fuel_mg / 1000.0 for t in crossed]),
            co2_g=_mean([t.co2_mg / 1000.0 for t in crossed]),
            fuel_total_g=sum(t.fuel_mg for t in crossed) / 1000.0,
            co2_total_g=sum(t.co2_mg for t in crossed) / 1000.0,
            by_class={name: _of_class(name, crossed) for name in sorted({t.vehicle_class for t in crossed})},
            safety=Safety(
                collisions_sumo=len(self._collided),
                collisions_geometric=overlaps,
                min_pet_s=least_pet_s,
                hard_brakes=self._hard_brakes,
                teleports=self._teleports,
            ),
        )


def free_flow_time_s(movement: Movement, zone_m: float, speed_mps: float, decel_mps2: float) -> float:
    """Time-to-goal of a lone vehicle that enters at `speed_mps` and slows late for its turn, s."""
    turn_mps = min(movement.turn_speed_mps or speed_mps, speed_mps)
    decel = min(COMFORTABLE_DECEL_MPS2, decel_mps2)
    braking_m = (speed_mps**2 - turn_mps**2) / (2.0 * decel)
    if braking_m > zone_m:
        entry_mps = float(np.sqrt(turn_mps**2 + 2.0 * decel * zone_m))
        return (entry_mps - turn_mps) / decel + movement.length_m / turn_mps
    return (zone_m - braking_m) / speed_mps + (speed_mps - turn_mps) / decel + movement.length_m / turn_mps


def _time_to_goal_s(trip: _Trip) -> float:
    assert trip.crossed_s is not None
    return trip.crossed_s - trip.entered_s


def _of_class(name: str, crossed: Sequence[_Trip]) -> ClassFigures:
    trips = [trip for trip in crossed if trip.vehicle_class == name]
    return ClassFigures(
        count=len(trips),
        time_to_goal_s=_mean([_time_to_goal_s(trip) for trip in trips]),
        fuel_g=_mean([trip.fuel_mg / 1000.0 for trip in trips]),
        co2_g=_mean([trip.co2_mg / 1000.0 for trip in trips]),
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _percentile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None
