"""THE HOT PATH: snapshot, decide, publish, every 100 ms. Everything else in this package serves this loop."""

from __future__ import annotations

import os
import time
from collections import Counter
from contextlib import AsyncExitStack

import structlog

from gameopt_im import heap, scheduling, whole_way
from gameopt_im.bus import Bus, configuration, endpoints
from gameopt_im.clock import LockStep, WallClock
from gameopt_im.garbage import BetweenCycles
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.recorder import Recorder
from gameopt_im.solver import contest
from gameopt_im.solver.contest import Solver
from gameopt_im.vitals import Vitals
from gameopt_im.warm_up import warm_up
from gameopt_im.web.hub import Hub
from gameopt_wire import codec
from gameopt_wire.intersection import Charter

log = structlog.get_logger()


async def serve(options: ServeOptions) -> None:
    """Run one intersection until cancelled. Raises `StartError` where it cannot start."""
    term = time.time_ns() // 1_000_000
    charter = charter_of(options, term)
    async with AsyncExitStack() as stack:
        # What can be refused comes first: a taken port is said at once, not after a minute of compiling.
        config = configuration(options.listen, options.connect, options.zenoh_config)
        lossless = options.clock == "lockstep"
        bus = await stack.enter_async_context(await Bus.connect(options.map.intersection, config, lossless))
        recorder = None
        if options.record is not None:
            recorder = stack.enter_context(Recorder(options.record, charter, options.parameters, options.command_line))
        vitals, hub = Vitals(options.clock), Hub(options, term)
        if options.http is not None:
            from gameopt_im.web import server

            await stack.enter_async_context(server.opened(options.http, options, vitals, hub))
        await warm_up(options)
        goes_first = options.clock == "wall" and options.parameters.service.realtime  # lock-step is in no hurry
        solver = solver_of(options, goes_first)
        await stack.enter_async_context(solver)
        vitals.programs = solver.counts
        realtime = goes_first and scheduling.go_first()  # not the threads that call back: they begin with the next line
        await bus.announce(codec.CHARTER.encode(charter))
        vitals.announce()
        log.info(
            "serving",
            intersection=options.map.intersection,
            clock=options.clock,
            profile=options.profile,
            geometry=options.geometry,
            endpoints=endpoints(config),
            realtime=realtime,
        )
        manager = Manager(options, term, solver)
        heap.reserve()
        await run(options, manager, bus, recorder, vitals, hub)


async def run(
    options: ServeOptions, manager: Manager, bus: Bus, recorder: Recorder | None, vitals: Vitals, hub: Hub
) -> None:
    """The loop itself: one control cycle after another, for as long as the task lives."""
    clock: WallClock | LockStep = (
        LockStep(bus)
        if options.clock == "lockstep"
        else WallClock(bus, options.parameters.service.collect_s, read=manager.read_ahead)
    )
    with BetweenCycles() as garbage:
        while True:
            tick = await clock.next_cycle()
            vitals.cycle_begun()
            if tick.restarted:
                manager.restart()
            manager.missed = clock.missed
            manager.unread = Counter({"overflow": bus.overflow}) + clock.rejected
            outcome = await manager.control_cycle(
                tick.cycle, tick.time_s, tick.messages, tick.left_s, bus.publish_commands
            )
            outcome = whole_way.measured(outcome, bus.closed_s, clock.late_s)
            bus.publish_cycle(outcome.report)
            for entry in outcome.ledger:
                bus.publish_ledger(entry)
            manager.published()
            if recorder is not None:
                recorder.record(tick, outcome.commands)
            vitals.cycle_done(outcome, manager.bids)
            hub.cycle_done(outcome, manager.sight)
            bus.cycle_done(manager.present)
            garbage.cycle_done()


def charter_of(options: ServeOptions, term: int) -> Charter:
    """What the manager says of itself to whoever asks for the map."""
    return Charter(
        term=term,
        clock=options.clock,
        profile=options.profile,
        geometry=options.geometry,
        turn_speed=options.turn_speed,
        candidates=options.candidates,
        workers=options.workers,
        process_id=os.getpid(),
        digest=options.map.digest(),
        map=options.map,
    )


def solver_of(options: ServeOptions, go_first: bool = False) -> Solver:
    """What solves the programs of the profile, warmed on them; its workers `go_first` where the system lets them."""
    return contest.solver_for(options.profile, options.workers, options.parameters, go_first)
