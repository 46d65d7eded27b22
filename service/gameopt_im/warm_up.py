"""Before the first control cycle: the real decision on made-up traffic, so that no cycle has to compile."""

from __future__ import annotations

import time
from dataclasses import replace

import structlog

from gameopt_im.inbox import Raw
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.solver import contest
from gameopt_wire import codec, keys
from gameopt_wire.messages import STEP_S, Command, State

log = structlog.get_logger()

CYCLES = 60
NOTICEABLE_S = 2.0


async def warm_up(options: ServeOptions) -> None:
    """Drive one vehicle a movement over the junction; the first run on a machine compiles, and says so."""
    started = time.perf_counter()
    log.info("warming up; the first run on a machine compiles for about a minute")
    rehearsal = replace(options, workers=0, clock="lockstep", record=None)
    async with contest.pool_for(rehearsal.profile, 0) as pool:
        manager = Manager(rehearsal, 0, pool)
        states = _traffic(rehearsal)
        for cycle in range(CYCLES):
            raw = [_raw(rehearsal, state) for state in states.values()]
            outcome = await manager.control_cycle(cycle, cycle * STEP_S, raw)
            for command in outcome.commands:
                states[command.vehicle] = _obey(states[command.vehicle], command)
    elapsed = time.perf_counter() - started
    if elapsed > NOTICEABLE_S:
        log.info("compiled", seconds=round(elapsed, 1))


def _traffic(options: ServeOptions) -> dict[str, State]:
    """Two vehicles a movement, near enough to ask for clearances at once."""
    made = {}
    for row in range(2):
        for movement in options.map.movements:
            zone = options.map.lanes[movement.lane].zone_m
            made[f"{movement.id}.{row}"] = State(
                vehicle=f"{movement.id}.{row}",
                time_s=0.0,
                movement=movement.id,
                distance_m=min(45.0 + 15.0 * row, zone),
                speed_mps=10.0,
                acceleration_mps2=0.0,
                length_m=5.0,
                width_m=1.8,
                vehicle_class="passenger",
                max_speed_mps=20.0,
                max_accel_mps2=2.6,
                max_decel_mps2=4.5,
            )
    return made


def _raw(options: ServeOptions, state: State) -> Raw:
    key = keys.of_vehicle(options.map.intersection, "state", state.vehicle)
    return Raw("state", codec.STATE.encode(state), key)


def _obey(state: State, command: Command) -> State:
    """The state one step later of a vehicle that does as it is told."""
    speed = command.speed_mps
    accepted = command.clearance.id if command.clearance is not None else state.accepted
    return State(
        vehicle=state.vehicle,
        time_s=command.time_s + STEP_S,
        movement=state.movement,
        distance_m=state.distance_m - 0.5 * STEP_S * (state.speed_mps + speed),
        speed_mps=speed,
        acceleration_mps2=(speed - state.speed_mps) / STEP_S,
        length_m=state.length_m,
        width_m=state.width_m,
        vehicle_class=state.vehicle_class,
        max_speed_mps=state.max_speed_mps,
        max_accel_mps2=state.max_accel_mps2,
        max_decel_mps2=state.max_decel_mps2,
        term=command.term,
        accepted=accepted,
    )
