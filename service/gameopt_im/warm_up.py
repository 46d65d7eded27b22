"""Before the first control cycle: the real decision on made-up traffic, so that no cycle has to compile."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace

import structlog

from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.solver import contest
from gameopt_wire.messages import STEP_S

log = structlog.get_logger()

CYCLES, SHORT_CYCLES = 65, 5
"""Control cycles; the first of them with no time left, for what is done then has to be compiled, too."""
NOTICEABLE_S = 2.0


async def warm_up(options: ServeOptions) -> None:
    """Drive two vehicles a movement over the junction; the first run on a machine compiles, and says so."""
    started = time.perf_counter()
    log.info("warming up; the first run on a machine compiles for about a minute")
    rehearsal = replace(options, workers=0, clock="lockstep", record=None)
    async with contest.solver_for(rehearsal.profile, 0, rehearsal.parameters) as pool:
        manager = Manager(rehearsal, 0, pool)
        traffic = Rehearsal(options.map, 2 * len(options.map.movements))
        for cycle in range(CYCLES):
            messages, left_s = traffic.messages(cycle * STEP_S), 0.0 if cycle < SHORT_CYCLES else None
            outcome = await manager.control_cycle(cycle, cycle * STEP_S, messages, left_s)
            traffic.obey(outcome.commands)
            await asyncio.sleep(0)  # who asks meanwhile whether the manager is ready gets an answer
    elapsed = time.perf_counter() - started
    if elapsed > NOTICEABLE_S:
        log.info("compiled", seconds=round(elapsed, 1))
