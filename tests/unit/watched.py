"""Control cycles of a real manager on made-up traffic, with what it leaves for those who watch; no test in here."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec

from gameopt_im import config
from gameopt_im.core.parameters import Parameters
from gameopt_im.manager import Manager, Outcome
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_im.sight import Sight
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import STEP_S, Profile

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
STOP_SIGN_TEXT = """
    auction = {order = "arrival"}
    planner = {incumbent = false, upstream = false}
    program = {solve = false}
    interlock = {ask = "standing"}
"""
STOP_SIGN = config.parse(STOP_SIGN_TEXT)


def options(profile: Profile = "default", parameters: Parameters | None = None) -> ServeOptions:
    geometry = "box" if profile == "paper" else "areas"
    return ServeOptions(
        map=ROADS, parameters=parameters or Parameters(), profile=profile, geometry=geometry, workers=0,
        clock="lockstep",
    )  # fmt: skip


def watch(serving: ServeOptions, cycles: int, see: Callable[[Outcome, Sight], None], vehicles: int = 24) -> None:
    """Call `see` after every control cycle, as the service does."""

    async def work() -> None:
        rehearsal = Rehearsal(ROADS, vehicles)
        async with solver_of(serving) as solver:
            manager = Manager(serving, 1, solver)
            for cycle in range(1, cycles + 1):
                outcome = await manager.control_cycle(cycle, cycle * STEP_S, rehearsal.messages(cycle * STEP_S))
                assert manager.sight is not None
                see(outcome, manager.sight)
                rehearsal.obey(outcome.commands)

    asyncio.run(work())
