"""The figures of the report against drives whose times are known."""

from __future__ import annotations

import msgspec
import pytest

from gameopt_sumo.figures import Measurements
from gameopt_sumo.measurements import Recorder, free_flow_time_s
from gameopt_sumo.network import packaged_map
from gameopt_sumo.observation import Observation

MAP = packaged_map()
STRAIGHT = next(m for m in MAP.movements if m.id == "0-1")
RIGHT = next(m for m in MAP.movements if m.id == "0-0")


def seen(vehicle: str, distance_m: float, speed_mps: float = 20.0, accel: float = 0.0) -> Observation:
    return Observation(
        vehicle,
        "0-1",
        distance_m,
        speed_mps,
        accel,
        5.0,
        1.8,
        "passenger",
        50.0,
        2.6,
        4.5,
        None,
        None,
        None,
        False,
        True,
    )


def drive(recorder: Recorder, vehicle: str, line_s: float, until_s: float, speed_mps: float = 20.0) -> None:
    """A vehicle at constant speed whose front is at the stop line at `line_s`."""
    for step in range(1, int(until_s * 10) + 1):
        distance_m = (line_s - step / 10) * speed_mps
        if distance_m <= 150.0:
            recorder.step(step / 10, [seen(vehicle, distance_m, speed_mps)])


def recorder() -> Recorder:
    return Recorder(MAP, lambda _: (500.0, 1500.0))


def figures(record: Recorder, from_s: float = 0.0, until_s: float = 60.0) -> Measurements:
    return record.measurements(from_s, until_s, overlaps=0, least_pet_s=None)


def test_times_run_between_the_lines_not_between_steps() -> None:
    record = recorder()
    record.due("a", 2.53)
    drive(record, "a", line_s=10.03, until_s=20.0)
    found = figures(record)

    expected = (150.0 + STRAIGHT.length_m) / 20.0
    assert found.time_to_goal_s.mean == pytest.approx(expected, abs=1e-6)
    assert found.time_loss_s.mean == pytest.approx(0.0, abs=1e-6)
    assert found.fuel_g == pytest.approx(0.5 * expected, abs=1e-6)
    assert found.co2_total_g == pytest.approx(1.5 * expected, abs=1e-6)
    assert found.by_class["passenger"].count == 1


def test_every_vehicle_due_is_somewhere() -> None:
    record = recorder()
    for vehicle, due_s in (("crossed", 5.0), ("inside", 50.0), ("held up", 55.0), ("later", 61.0)):
        record.due(vehicle, due_s)
    drive(record, "crossed", line_s=12.5, until_s=30.0)
    drive(record, "inside", line_s=61.0, until_s=60.0)
    counts = figures(record).vehicles

    assert (counts.arrived, counts.entered, counts.crossed) == (3, 2, 1)
    assert (counts.in_zone, counts.waiting_to_enter) == (1, 1)


def test_the_warm_up_counts_only_in_the_throughput_of_what_crosses_later() -> None:
    record = recorder()
    drive(record, "before", line_s=10.0, until_s=30.0)  # enters at 2.5 s, crosses at 11.4 s
    drive(record, "after", line_s=20.0, until_s=30.0)  # enters at 12.5 s
    found = figures(record, from_s=11.0, until_s=71.0)

    assert found.vehicles.crossed == found.vehicles.arrived == 1
    assert found.throughput_veh_min == pytest.approx(2.0)
    assert found.time_to_goal_s.max == pytest.approx((150.0 + STRAIGHT.length_m) / 20.0, abs=1e-6)


def test_a_slow_vehicle_loses_the_difference() -> None:
    record = recorder()
    drive(record, "slow", line_s=20.0, until_s=40.0, speed_mps=10.0)
    way_m = 150.0 + STRAIGHT.length_m
    assert figures(record).time_loss_s.max == pytest.approx(way_m / 10.0 - way_m / 20.0, abs=1e-6)


def test_hard_braking_counts_once_per_event() -> None:
    record = recorder()
    for step, accel in enumerate((-3.0, -4.0, -4.5, -4.5, 0.0, -4.2)):
        record.step(0.1 * step, [seen("a", 100.0 - step, accel=accel)])
    assert figures(record).safety.hard_brakes == 2


def test_a_pair_collides_once_whoever_is_named_first() -> None:
    record = recorder()
    record.collided([("a", "b"), ("b", "a"), ("a", "c")])
    record.collided([("a", "b")])
    record.teleported(2)
    safety = figures(record).safety
    assert (safety.collisions_sumo, safety.teleports) == (2, 2)


def test_free_flow_slows_for_the_turn_as_late_as_it_can() -> None:
    assert RIGHT.turn_speed_mps is not None
    turn = RIGHT.turn_speed_mps
    braking_s, braking_m = (20.0 - turn) / 3.0, (400.0 - turn**2) / 6.0
    expected = (150.0 - braking_m) / 20.0 + braking_s + RIGHT.length_m / turn
    assert free_flow_time_s(RIGHT, 150.0, 20.0, 4.5) == pytest.approx(expected)
    # Too short to slow down from the limit: it comes in slower.
    assert free_flow_time_s(RIGHT, 10.0, 20.0, 4.5) < 10.0 / turn + RIGHT.length_m / turn


def test_an_empty_run_has_nulls_and_the_fields_of_the_report() -> None:
    found = msgspec.to_builtins(figures(recorder()))
    assert set(found["vehicles"]) == {"arrived", "entered", "crossed", "in_zone", "waiting_to_enter"}
    assert found["time_to_goal_s"] == {"mean": None, "p50": None, "p95": None, "max": None}
    assert set(found["safety"]) == {
        "collisions_sumo", "collisions_geometric", "min_pet_s", "hard_brakes", "teleports"
    }  # fmt: skip
    assert found["fuel_g"] is None
    assert found["throughput_veh_min"] == 0.0
