"""The interlock on bad links: nobody touches, whatever gets lost, and everybody comes through once the link is back."""

from __future__ import annotations

import asyncio

from hostile_world import DT, Weather
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lossy_world import Link, LossyWorld, Outage
from test_interlock_properties import check_ground, footprint

LOSSY_S = 45.0
PATIENCE_S = 180.0
"""Messages go through again from `LOSSY_S` on, nobody enters any more, and after this long all have to be across."""
PLAY_M = 0.05
EARLY_M, LATE_M = 0.4, 0.6
"""A vehicle takes a clearance only if it will never be farther off it, and its leader may have been late besides.

Together they are `interlock.margin_m`: windows stay apart if one is early and the other late.
"""


def check_uncleared(world: LossyWorld) -> None:
    """Who follows no clearance can still stop before the line, or has left the conflict zone."""
    for car in world.cars:
        movement = world.roads.movements[car.movement]
        through = car.rear >= movement.clear_m and car.x >= movement.length_m
        if world.cleared(car) or through or car.x < -149.0:
            continue
        assert car.x < 0.0, f"{car} is past the line at {world.time_s:.1f} s"
        setback = (movement.setback_m or [0.0] * 9)[footprint(world, car)]
        room = -car.x - setback - 1.0
        assert car.room_to_stop() <= room + PLAY_M, f"{car} cannot stop at {world.time_s:.1f} s"


def check_rear_ends(world: LossyWorld) -> None:
    """Everybody keeps the standing gap to the next vehicle on its path."""
    for car in world.cars:
        found = world.leader_of(car)
        if found is None:
            continue
        other, way = found
        parted = other.movement != car.movement and other.rear > 0.0 and world._lane(other) == world._lane(car)
        assert parted or way >= 2.0 - PLAY_M, f"{way:.2f} m from {car} to {other} at {world.time_s:.1f} s"


def check_held(world: LossyWorld) -> None:
    """The ground of whoever follows a clearance is held, from before it comes until after it has gone."""
    for car in world.cars:
        taken = world.agents[car.name]._accepted
        if taken is None:
            continue
        held = world.book.held[car.name]
        if not held.clearance:  # a profile as long as the horizon is over before the vehicle is clear
            assert taken.profile.ended(world.time_s + 2.0 * DT)
            continue
        k = held.step(world.cycle)
        assert held.clearance == taken.id
        assert car.x <= held.x[k] + EARLY_M + PLAY_M, f"{car} is ahead of its profile at {world.time_s:.1f} s"
        late = float(held.late_x[k] - car.x)
        assert late <= LATE_M, f"{car} is {late:.2f} m behind its worst case at {world.time_s:.1f} s"


async def run(world: LossyWorld) -> None:
    """Until everybody is across; every check after every step."""
    while world.time_s < LOSSY_S + PATIENCE_S and (world.cars or world.time_s < LOSSY_S):
        world.entering = world.time_s < LOSSY_S
        before = {car.name: car.x for car in world.cars}
        await world.advance()
        for car in world.cars:
            before.setdefault(car.name, car.x)
        check_ground(world, before)
        check_uncleared(world)
        check_rear_ends(world)
        check_held(world)
    assert not world.cars, f"still waiting: {', '.join(map(str, world.cars))}"
    assert world.crossed > 0


shares = st.sampled_from([0.0, 0.2, 0.5, 0.7])
outages = st.builds(
    Outage,
    start_s=st.floats(0.0, 30.0),
    length_s=st.floats(3.0, 30.0),
    up=st.booleans(),
    down=st.booleans(),
    every=st.sampled_from([1, 2, 5]),
)
links = st.builds(
    Link,
    up_lost=shares,
    down_lost=shares,
    delay_s=st.sampled_from([0.0, 0.1, 0.3]),
    jitter_s=st.sampled_from([0.0, 0.1, 0.3]),
    outages=st.lists(outages, max_size=3).map(tuple),
    until_s=st.just(LOSSY_S),
)


@settings(max_examples=8)
@given(
    links,
    st.sampled_from(["four-arm", "crossroads"]),
    st.booleans(),
    st.sampled_from([0.03, 0.1]),
    st.integers(0, 2**32 - 1),
)
def test_nobody_touches_whatever_is_lost(link: Link, name: str, slotless: bool, flow: float, seed: int) -> None:
    asyncio.run(run(LossyWorld(name, Weather(slotless=slotless, flow=flow), link, seed)))


noisy_links = st.builds(
    Link,
    up_lost=st.sampled_from([0.0, 0.2]),
    down_lost=st.sampled_from([0.0, 0.2]),
    delay_s=st.sampled_from([0.0, 0.1]),
    noise_mps=st.just(0.2),
)


@settings(max_examples=8)
@example(Link(up_lost=0.2, down_lost=0.2, delay_s=0.1, noise_mps=0.2), "four-arm", 0.05, 5458)
@given(
    noisy_links, st.sampled_from(["four-arm", "crossroads"]), st.sampled_from([0.05, 0.2]), st.integers(0, 2**32 - 1)
)
def test_nobody_touches_whose_speed_is_never_what_it_aims_at(link: Link, name: str, flow: float, seed: int) -> None:
    """Their profiles slip: whoever can still stop then gives way, and is not forgotten."""

    async def drive() -> None:
        world = LossyWorld(name, Weather(flow=flow), link, seed)
        while world.time_s < LOSSY_S:
            before = {car.name: car.x for car in world.cars}
            await world.advance()
            for car in world.cars:
                before.setdefault(car.name, car.x)
            check_ground(world, before)
            for car in world.cars:
                if (found := world.leader_of(car)) is not None and world._lane(found[0]) == world._lane(car):
                    assert found[1] > 0.0, f"{car} touches {found[0]} at {world.time_s:.1f} s"
        assert world.crossed > 0

    asyncio.run(drive())
