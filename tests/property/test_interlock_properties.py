"""The interlock under a hostile planner: nobody touches, whatever is planned and whatever gets lost."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hostile_world import CLASSES, DT, Car, Weather, World
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core.reservations import Reservation
from gameopt_wire.intersection import ConflictArea

STEPS = 250
PLAY_M = 0.05
"""Stops that end within a step, and rules that are kept to a float's last digits."""


def footprint(world: World, car: Car) -> int:
    length, width = CLASSES[car.kind][:2]
    fits = [k for k, each in enumerate(world.roads.footprints) if each.length_m >= length and each.width_m >= width]
    return min(fits, key=lambda k: world.roads.footprints[k].length_m * world.roads.footprints[k].width_m)


def windows(world: World, area: ConflictArea, a: Car, b: Car) -> tuple[tuple[float, float], ...] | None:
    """The ground of a (on the area's first movement) and of b, m past their lines; None: they never touch."""
    f, g = footprint(world, a), footprint(world, b)
    mine, its = area.a_windows_m[f][g], area.b_windows_m[g][f]
    if mine is None or its is None:
        return None
    if world.weather.geometry == "box" and not area.beside:
        return (0.0, 25.0), (0.0, 25.0)
    return mine, its


def check_ground(world: World, before: dict[str, float]) -> None:
    """No two cars on one conflict area, at the step's end and on the way there."""
    by_movement: dict[int, list[Car]] = {}
    for car in world.cars:
        if car.x >= -20.0:
            by_movement.setdefault(car.movement, []).append(car)
    for area in world.roads.areas:
        if world.roads.movements[area.a].lane == world.roads.movements[area.b].lane:
            continue
        for a, b in itertools.product(by_movement.get(area.a, ()), by_movement.get(area.b, ())):
            ground = windows(world, area, a, b)
            if ground is None:
                continue
            for part in (0.25, 0.5, 0.75, 1.0):
                on = [
                    enter < before[car.name] + part * (car.x - before[car.name]) < leave + car.length
                    for car, (enter, leave) in zip((a, b), ground, strict=True)
                ]
                assert not all(on), f"{a} and {b} on one area at {world.time_s:.1f} s"


def check_gaps(world: World) -> None:
    """Two metres behind whoever is ahead in the lane, and behind whoever is ahead on the exit lane."""
    for car in world.cars:
        found = world.leader_of(car)
        if found is None:
            continue
        other, way = found
        parted = other.movement != car.movement and other.rear > 0.0 and world._lane(other) == world._lane(car)
        if not parted:
            assert way >= 2.0 - PLAY_M, f"{way:.2f} m from {car} to {other} at {world.time_s:.1f} s"


def check_uncleared(world: World) -> None:
    """Who follows no clearance can still stop before the line."""
    for car in world.cars:
        if car.reservation is None and car.x > -149.0:
            assert car.x < 0.0, f"{car} is past the line"
            setback = (world.roads.movements[car.movement].setback_m or [0.0] * 9)[footprint(world, car)]
            assert car.room_to_stop() <= -car.x - setback - 1.0 + PLAY_M, f"{car} cannot stop"


def check_cleared(world: World, play: float) -> None:
    """Who follows one is never ahead of its profile, nor behind the worst case its ground is held for."""
    for car in world.cars:
        taken = car.reservation
        held = world.book.held.get(car.name)
        if taken is None or held is None or not held.accepted:
            continue
        k = held.step(world.cycle)
        assert held.clearance == taken.clearance
        assert car.x <= held.x[k] + play, f"{car} is ahead of its profile"
        assert car.x >= held.late_x[k] - play, f"{car} is {held.late_x[k] - car.x:.2f} m behind its worst case"


def reach(x: np.ndarray, distance: float) -> float:
    """Steps until a way reaches a distance, infinite if it never does."""
    k = int(np.argmax(x >= distance))
    if x[k] < distance:
        return np.inf
    return float(k if k == 0 else k - 1 + (distance - x[k - 1]) / (x[k] - x[k - 1]))


def check_windows(world: World) -> None:
    """The windows of any two clearances are disjoint by the margin, from first entry to last exit."""
    held = [each for each in world.book.held.values() if each.clearance]
    of = world.ground.windows
    for a, b in itertools.combinations(held, 2):
        mine = of[a.movement, a.footprint, b.movement, b.footprint]
        its = of[b.movement, b.footprint, a.movement, a.footprint]
        if np.isnan(mine[0]):
            continue
        a_in, a_out = span(a, mine)
        b_in, b_out = span(b, its)
        margin = world.parameters.interlock.margin_s / DT - 0.1
        disjoint = b_in >= a_out + margin or a_in >= b_out + margin
        assert disjoint, f"{a.vehicle} {b.vehicle} {a_in, a_out, b_in, b_out}"


def span(each: Reservation, ground: np.ndarray) -> tuple[float, float]:
    """(in, out) in control cycles."""
    return each.start + reach(each.x, ground[0]), each.start + reach(each.late_x, ground[1] + each.length)


def run(world: World, steps: int) -> None:
    weather = world.weather
    lossy = weather.reluctant + weather.commands_lost + weather.states_lost > 0.0
    play = 0.5 if lossy else 0.1
    for _ in range(steps):
        before = {car.name: car.x for car in world.cars}
        world.step()
        for car in world.cars:
            before.setdefault(car.name, car.x)
        check_ground(world, before)
        check_gaps(world)
        check_uncleared(world)
        check_cleared(world, play)
        check_windows(world)


def test_two_cars_put_on_one_area_are_seen() -> None:
    """The check itself."""
    world = World("four-arm", Weather(), 1)
    area = next(each for each in world.roads.areas if not each.beside)
    mine, its = area.a_windows_m[0][0], area.b_windows_m[0][0]
    assert mine is not None
    assert its is not None
    x = mine[0] + 1.0, its[0] + 1.0
    world.cars = [Car("a", "passenger", area.a, x[0], 10.0, 0), Car("b", "passenger", area.b, x[1], 10.0, 0)]
    with pytest.raises(AssertionError, match="on one area"):
        check_ground(world, {"a": x[0] - 1.0, "b": x[1] - 1.0})


weathers = st.builds(
    Weather,
    geometry=st.sampled_from(["areas", "box"]),
    slotless=st.booleans(),
    flow=st.sampled_from([0.03, 0.1, 0.4]),
)


@settings(max_examples=12)
@given(weathers, st.sampled_from(["four-arm", "crossroads"]), st.integers(0, 2**32 - 1))
def test_nobody_touches_whatever_is_planned(weather: Weather, name: str, seed: int) -> None:
    world = World(name, weather, seed)
    run(world, STEPS)
