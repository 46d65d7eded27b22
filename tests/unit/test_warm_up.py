"""Whatever a control cycle needs is compiled before the first one."""

from __future__ import annotations

import asyncio
import gc

import pytest
from numba.core.dispatcher import Dispatcher

from gameopt_im.core.parameters import Parameters
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_im.warm_up import warm_up
from gameopt_sumo.network import packaged_map
from gameopt_wire.messages import STEP_S


def compiled() -> dict[str, int]:
    """How many sets of argument types each kernel has been compiled for."""
    kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {f"{each.__module__}.{each.__name__}": len(each.signatures) for each in kernels}


@pytest.mark.slow
def test_no_control_cycle_compiles() -> None:
    async def traffic_of(count: int, left_s: float | None) -> None:
        rehearsal = Rehearsal(OPTIONS.map, count)
        async with solver_of(OPTIONS) as solver:
            manager = Manager(OPTIONS, 1, solver)
            for cycle in range(1, 80):
                messages = rehearsal.messages(cycle * STEP_S)
                outcome = await manager.control_cycle(cycle, cycle * STEP_S, messages, left_s)
                rehearsal.obey(outcome.commands)

    asyncio.run(warm_up(OPTIONS))
    before = compiled()
    for count in (1, 5, 60, 200):
        asyncio.run(traffic_of(count, None))
        asyncio.run(traffic_of(count, 0.0))
    assert compiled() == before


OPTIONS = ServeOptions(map=packaged_map(), parameters=Parameters(), workers=0, clock="lockstep")
