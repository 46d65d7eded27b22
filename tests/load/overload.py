"""Control cycles with more vehicles than there is time for, with the budget and without: the table of docs/overload.md.

    python tests/load/overload.py [VEHICLES ...]

Made-up traffic that obeys, on the packaged junction with 600 m of control zone, so that a thousand vehicles fit on it;
nothing is sent anywhere. Takes a few minutes. CPU is the manager's own time, without its workers': on a machine that
does other things it says more than the time that went by.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from gameopt_im.core.parameters import Parameters
from gameopt_im.garbage import BetweenCycles
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_im.warm_up import warm_up
from gameopt_sumo.network import packaged_map
from gameopt_wire.messages import STEP_S, CycleReport

ZONE_M = 600.0
SETTLING_CYCLES, CYCLES = 150, 150
LEFT_S = 0.08
"""From the beginning of a control cycle to the next grid point, with `service.collect_s` as it is."""
COUNTS = (260, 520, 1040)


async def measure(options: ServeOptions, count: int, left_s: float | None) -> str:
    """A line of the table."""
    traffic, reports, own_ms = Rehearsal(options.map, count), list[CycleReport](), list[float]()
    async with solver_of(options) as solver:
        manager = Manager(options, 1, solver)
        with BetweenCycles() as garbage:
            for cycle in range(1, SETTLING_CYCLES + CYCLES + 1):
                begun, messages = time.perf_counter(), traffic.messages(cycle * STEP_S)
                spent = time.process_time()
                outcome = await manager.control_cycle(cycle, cycle * STEP_S, messages, left_s)
                manager.published()
                own_ms.append(1e3 * (time.process_time() - spent))
                traffic.obey(outcome.commands)
                reports.append(outcome.report)
                garbage.cycle_done()
                # Workers that have been left behind catch up between control cycles, as they do at the wall clock.
                await asyncio.sleep(max(0.0, begun + STEP_S - time.perf_counter()))
    seen = reports[SETTLING_CYCLES:]
    times = np.percentile([report.elapsed_ms for report in seen], [50, 99, 100])
    stages = {name: np.median([report.stages_ms[name] for report in seen]) for name in seen[-1].stages_ms}
    dropped = (seen[-1].dropped_total - reports[SETTLING_CYCLES - 1].dropped_total) / CYCLES
    unsolved = (seen[-1].unsolved_total - reports[SETTLING_CYCLES - 1].unsolved_total) / CYCLES
    late = seen[-1].qp_late_total - reports[SETTLING_CYCLES - 1].qp_late_total
    figures = [
        f"{seen[-1].vehicles}",
        f"{np.median([report.uncleared for report in seen]):.0f}",
        "no" if left_s is None else "yes",
        *(f"{each:.1f}" for each in times),
        *(f"{each:.1f}" for each in np.percentile(own_ms[SETTLING_CYCLES:], [50, 99])),
        f"{sum(report.elapsed_ms > 1e3 * LEFT_S for report in seen)}",
        f"{dropped:.1f}",
        f"{100 * unsolved:.0f} %",
        f"{late}",
        ", ".join(f"{name} {each:.1f}" for name, each in stages.items()),
    ]
    return "| " + " | ".join(figures) + " |"


async def main(counts: Sequence[int]) -> None:
    """The whole table."""
    known = packaged_map()
    lanes = [msgspec.structs.replace(lane, zone_m=ZONE_M) for lane in known.lanes]
    roads = msgspec.structs.replace(known, lanes=lanes)
    wall = ServeOptions(map=roads, parameters=Parameters(), clock="wall")
    await warm_up(replace(wall, map=known))
    head = "vehicles|uncleared|budget|p50 ms|p99|max|CPU p50|CPU p99|over 80 ms|dropped|unsolved|late programs"
    head += "|stages, median ms"
    print(f"| {head.replace('|', ' | ')} |\n|{' ---: |' * 13}", flush=True)  # noqa: T201
    for count in counts:
        for left_s in (LEFT_S, None):
            clock = replace(wall, clock="wall" if left_s is not None else "lockstep")
            print(await measure(clock, count, left_s), flush=True)  # noqa: T201


if __name__ == "__main__":
    asyncio.run(main([int(each) for each in sys.argv[1:]] or COUNTS))
