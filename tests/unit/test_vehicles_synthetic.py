"""The synthetic road keeps vehicles coming, and agents left to themselves queue on it without touching."""

from __future__ import annotations

import msgspec
import pytest
from builders import four_arm, movement

from gameopt_vehicles import driving
from gameopt_vehicles.agent import Agent
from gameopt_vehicles.report import Measurements
from gameopt_vehicles.synthetic import SyntheticRoad
from gameopt_wire.intersection import Lane

LANES = 4
MAP = four_arm(
    lanes=[Lane(id=f"lane{k}", approach=k, speed_limit_mps=20.0, zone_m=150.0) for k in range(LANES)],
    movements=[  # of every road the right turn and the one straight on, from the same lane
        movement(
            3 * lane + k,
            lane=lane,
            exit_lane=f"exit{(lane + k) % LANES}",
            exit_length_m=60.0,
            length_m=20.0 + 10.0 * k,
            clear_m=20.0,
            turn_speed_mps=None if k else 7.0,
        )
        for lane in range(LANES)
        for k in range(2)
    ],
    areas=[],
)


def record(road: SyntheticRoad) -> list[tuple[str, float, float, float | None]]:
    return [(v.vehicle, v.distance_m, v.speed_mps, v.leader_gap_m) for v in road.step()]


@pytest.mark.parametrize("present", [8, 40])
def test_agents_without_a_manager_queue_at_the_line_without_touching(present: int) -> None:
    road = SyntheticRoad(MAP, present, seed=1)
    agents: dict[str, Agent] = {}
    lanes = {movement.id: MAP.lanes[movement.lane] for movement in MAP.movements}
    movements = {movement.id: movement for movement in MAP.movements}
    for k in range(1, 401):
        observations = road.step()
        for seen in observations:
            assert seen.leader_gap_m is None or seen.leader_gap_m >= 1.9, seen
            agent = agents.get(seen.vehicle) or agents.setdefault(
                seen.vehicle, Agent(seen, movements[seen.movement], lanes[seen.movement], seed=1)
            )
            agent.observe(seen, k / 10)
            road.set_speed(seen.vehicle, agent.act(seen, k / 10))
    assert len(observations) == present
    assert all(seen.speed_mps < 0.1 for seen in observations)
    assert min(seen.distance_m for seen in observations) >= 0.99
    assert sum(seen.distance_m < 2.0 for seen in observations) == LANES


def test_those_that_leave_are_replaced() -> None:
    road = SyntheticRoad(MAP, 12, seed=1)
    for _ in range(600):
        for seen in road.step():
            road.set_speed(seen.vehicle, 15.0)
    figures = msgspec.convert(road.measurements(0.0), Measurements)
    assert len(road.step()) >= 10
    crossed = figures.vehicles.crossed
    assert crossed is not None
    assert crossed > 40
    assert figures.throughput_veh_min == pytest.approx(crossed)
    assert figures.time_to_goal_s.max == pytest.approx(11.0, abs=1.5)


def test_whoever_appears_can_still_stop_where_the_map_wants_it_to_wait() -> None:
    setback_m = 7.0
    movements = [msgspec.structs.replace(each, setback_m=[setback_m] * len(MAP.footprints)) for each in MAP.movements]
    road = SyntheticRoad(msgspec.structs.replace(MAP, movements=movements), 60, seed=1)
    known: set[str] = set()
    for _ in range(300):
        for seen in road.step():
            if seen.vehicle not in known:
                assert driving.can_stop(seen, setback_m), seen
                known.add(seen.vehicle)
            road.set_speed(seen.vehicle, seen.speed_mps + 0.1)
    assert len(known) > 100


def test_the_same_seed_gives_the_same_traffic() -> None:
    def traffic(seed: int) -> list[list[tuple[str, float, float, float | None]]]:
        road = SyntheticRoad(MAP, 12, seed)
        return [record(road) for _ in range(50)]

    assert traffic(1) == traffic(1)
    assert traffic(1) != traffic(2)


@pytest.mark.parametrize("exit_m", [60.0, 400.0])
def test_vehicles_leave_where_their_exit_ends_or_is_no_longer_watched(exit_m: float) -> None:
    movements = [msgspec.structs.replace(each, exit_length_m=exit_m) for each in MAP.movements]
    road = SyntheticRoad(msgspec.structs.replace(MAP, movements=movements), 8, seed=1)
    farthest = 0.0
    for _ in range(300):
        for seen in road.step():
            past_m = -seen.distance_m - movements[seen.movement_index].length_m
            farthest = max(farthest, past_m)
            road.set_speed(seen.vehicle, 20.0)
    assert farthest == pytest.approx(min(exit_m, 250.0), abs=2.0)
