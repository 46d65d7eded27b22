"""The measured part of the report, field for field as the JSON has it."""

from __future__ import annotations

import msgspec


class VehicleCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Vehicles of the measuring window: all that had not entered the control zone when it began.

    `arrived` were due at the control zone, driving freely from their scheduled departure, by the window's
    end; of these `entered` came in and `waiting_to_enter` did not, and of those that came in `crossed`
    reached their exit lane and `in_zone` did not. So arrived = crossed + in_zone + waiting_to_enter, always.
    """

    arrived: int
    entered: int
    crossed: int
    in_zone: int
    waiting_to_enter: int


class TimeToGoal(msgspec.Struct, frozen=True, kw_only=True):
    """Front bumper at the control zone's entry to front bumper on the exit lane, s."""

    mean: float | None
    p50: float | None
    p95: float | None
    max: float | None


class TimeLoss(msgspec.Struct, frozen=True, kw_only=True):
    """Time-to-goal less that of a lone vehicle at the limits, s."""

    mean: float | None
    p95: float | None
    max: float | None


class ClassFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Means of one vehicle class over its vehicles that crossed."""

    count: int
    time_to_goal_s: float | None
    fuel_g: float | None
    co2_g: float | None


COLLISIONS = ("collisions_sumo", "collisions_geometric", "teleports")
"""Counts of `Safety` none of which is zero in a run in which vehicles collided, or were teleported out of it."""


class Safety(msgspec.Struct, frozen=True, kw_only=True):
    """Over the whole run, warm-up included: a collision is a collision whenever it happens.

    Collisions are distinct pairs; `hard_brakes` counts how often a vehicle began to brake beyond 4 m/s^2.
    """

    collisions_sumo: int
    collisions_geometric: int
    min_pet_s: float | None
    hard_brakes: int
    teleports: int


class Measurements(msgspec.Struct, frozen=True, kw_only=True):
    """What the simulator showed; means and totals over the vehicles `crossed`, None without any.

    `throughput_veh_min` counts every crossing in the measuring window, also by vehicles that had entered
    before.
    """

    vehicles: VehicleCounts
    throughput_veh_min: float | None
    time_to_goal_s: TimeToGoal
    time_loss_s: TimeLoss
    fuel_g: float | None
    co2_g: float | None
    fuel_total_g: float
    co2_total_g: float
    by_class: dict[str, ClassFigures]
    safety: Safety
