"""The manager of one intersection: everything a control cycle decides, from raw messages to commands.

It has no clock and no network; `service.py` gives it both, a replay gives it recorded ones.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import structlog

from gameopt_im.commands import commands_of
from gameopt_im.core import decision, planning
from gameopt_im.core.budget import Effort, Load, Took
from gameopt_im.core.conflicts import ground
from gameopt_im.core.decision import Conclusion, Picture, Settled, Winner
from gameopt_im.core.interlock import INTRUDING, UNCLEARED
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.inbox import Raw
from gameopt_im.ledger import Ledger
from gameopt_im.options import ServeOptions
from gameopt_im.pace import Pace
from gameopt_im.sight import Sight
from gameopt_im.solver.contest import Solver
from gameopt_im.strategy import Strategy, strategy_of
from gameopt_im.tracker import Event, Tracker
from gameopt_wire.messages import Command, CycleReport, LedgerEntry

log = structlog.get_logger()

QUIET_CYCLES = 100
"""Control cycles without a refusal after which the next one is said again."""
NAMED = 5
"""Vehicles that are named in a line of the log, whatever their number."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a control cycle came to: what to send, and what to write down.

    `decided_s` is when its commands stood, and `published_s` when they were out, on the clock of `time.perf_counter`.
    """

    commands: list[Command]
    report: CycleReport
    ledger: list[LedgerEntry]
    decided_s: float = 0.0
    published_s: float = 0.0


class Manager:
    """One intersection under one term; `control_cycle` is called once per control cycle, in order."""

    def __init__(self, options: ServeOptions, term: int, solver: Solver) -> None:
        self.options = options
        self.term = term
        self.missed = 0
        self.unread: Counter[str] = Counter()
        """Messages that never reached the tracker, by reason: broken steps, and what the queue had no room for."""
        self.sight: Sight | None = None
        """What the last control cycle saw and weighed, for whoever watches."""
        self._ground = ground(
            options.map, options.geometry, options.parameters.program.lateral_margin_m, options.turn_speed
        )
        self._tracker = Tracker(options.map, self._ground, options.parameters, options.clock, term)
        self._solver = solver
        self._strategy = self._fresh_strategy()
        self._pace = Pace(options)
        self._book = Book()
        self._order: tuple[str, ...] = ()
        self._next_clearance = 1
        self._ledger = Ledger(term)
        self._ahead = 0
        """Messages of the next control cycle that have been read."""
        self._flooded = False
        self._stage_started = self._planned = 0.0
        self._stages: dict[str, float] = {}
        self._solved = 0, 0, False
        """Programs begun and solved in the last control cycle."""
        self._refused, self._refusing_until = 0, -1

    @property
    def bids(self) -> int:
        """Bids taken since the start of the term."""
        return self._tracker.bids

    @property
    def present(self) -> tuple[str, ...]:
        """The vehicles of the last control cycle."""
        return self.sight.snapshot.ids if self.sight is not None else ()

    def _fresh_strategy(self) -> Strategy:
        return strategy_of(self.options, self._ground)

    def restart(self) -> None:
        """Lock-step time began anew: forget every vehicle and clearance, and how the last programs ended."""
        self._tracker.reset()
        self._strategy = self._fresh_strategy()
        self._book, self._order, self._next_clearance = Book(), (), 1
        self._ahead, self._flooded = 0, False
        self._ledger.clear()

    def read_ahead(self, messages: Sequence[Raw], time_s: float) -> int:
        """Read the next of the messages that the control cycle at `time_s` will be given, while others are waited for.

        Returns how many it has read. In a flood as many as fit may have been read by then: none of the rest is, for
        the control cycle chooses the newest of them, once.
        """
        self._flooded = self._flooded or not self._tracker.has_room(len(messages))
        if self._flooded:
            return 0
        self._tracker.ingest(messages, time_s)
        self._ahead += len(messages)
        return len(messages)

    async def control_cycle(
        self,
        cycle: int,
        time_s: float,
        messages: list[Raw],
        left_s: float | None = None,
        publish: Callable[[list[Command]], None] | None = None,
    ) -> Outcome:
        """Messages in, commands out; the same in, the same out. Those read ahead are the first of them.

        With `left_s`, the time to the next grid point, as much is tried as fits (`pace.py`); None: everything.
        `publish` is given the commands as soon as they stand: the books are written after it.
        """
        started = self._stage_started = time.perf_counter()
        self._tracker.ingest(messages[self._ahead :], time_s)
        self._ahead, self._flooded = 0, False
        self._mark("ingest")
        snapshot = self._tracker.snapshot(cycle, time_s, self._book.held.keys())
        settled = decision.settle(self._book, snapshot, self._ground)
        picture = decision.picture(snapshot, self._ground, self._book, self.options.parameters)
        limits = picture.limits
        self._mark("snapshot")

        parameters = self.options.parameters
        load = Load(len(snapshot), int(np.count_nonzero(limits.phase == UNCLEARED)))
        effort = self._pace.effort(load, self._stage_started - started, left_s, 1e-3 * self._stages["snapshot"])
        who = planning.bidders(snapshot, self._ground, self._book, limits, parameters, max(1, effort.candidates))
        proposal = self._strategy.propose(snapshot, self._book, limits, who, self._order, self._still)
        self._mark("auction")
        late_before = self._solver.counts.late
        results = await self._solver.solve(proposal.jobs, self._deadline())
        winner = self._strategy.choose(proposal, results)
        self._mark("programs")
        self._planned = self._stage_started
        ready = sum(result is not None for result in results)
        self._solved = len(results), ready, self._solver.counts.late > late_before

        concluded = decision.conclude(
            snapshot, self._ground, self._book, picture, who, winner, parameters,
            self._next_clearance, self._strategy.slotless,
        )  # fmt: skip
        self._next_clearance += len(concluded.grants.given)
        self._tracker.reserved = frozenset(self._book.held)
        self._mark("interlock")
        held, valid_s = self._book.held, parameters.service.command_valid_s
        commands = commands_of(snapshot, limits, concluded, held, self.term, valid_s)
        self._mark("commands")
        decided_s = self._stage_started
        if publish is not None:
            publish(commands)
        published_s = time.perf_counter()
        events = self._tracker.take_events()
        ledger = self._ledger.write(settled, events, time_s)
        self._order = tuple(snapshot.ids[i] for i in concluded.order)
        elapsed_ms = 1e3 * (decided_s - started)
        report = self._report(snapshot, picture, concluded, winner, proposal.count, len(commands), elapsed_ms)
        self._log(settled, events, picture, snapshot)
        self.sight = Sight(
            snapshot, limits.phase, self._book, who, proposal, results, winner, concluded, self._tracker.vehicle
        )
        return Outcome(commands, report, ledger, decided_s, published_s)

    def _still(self) -> Effort:
        return self._pace.still(time.perf_counter() - self._stage_started)

    def _deadline(self) -> float | None:
        """On the loop's clock; in lock-step there is none, so that nothing depends on the machine."""
        if self.options.clock == "lockstep":
            return None
        most_s = self._pace.deadline_s(1e-3 * self._stages["auction"], self.options.parameters.program.deadline_s)
        return asyncio.get_running_loop().time() + most_s

    def published(self) -> None:
        """The commands of the last control cycle are out: what it took decides what the next one tries."""
        snapshot, sequences, programs = (1e-3 * self._stages[stage] for stage in ("snapshot", "auction", "programs"))
        self._pace.learn(Took(sequences, programs, time.perf_counter() - self._planned, snapshot), *self._solved)

    def _mark(self, stage: str) -> None:
        now = time.perf_counter()
        self._stages[stage] = 1e3 * (now - self._stage_started)
        self._stage_started = now

    def _report(
        self,
        snapshot: Snapshot,
        picture: Picture,
        concluded: Conclusion,
        winner: Winner | None,
        candidates: int,
        commands: int,
        elapsed_ms: float,
    ) -> CycleReport:
        counts = self._solver.counts
        cleared = sum(r.accepted and r.clearance > 0 for r in self._book.held.values())
        return CycleReport(
            term=self.term,
            cycle=snapshot.cycle,
            time_s=snapshot.time_s,
            vehicles=len(snapshot),
            uncleared=int(np.count_nonzero(picture.limits.phase == UNCLEARED)),
            cleared=cleared,
            commands=commands,
            candidates=candidates,
            selected=winner.number if winner is not None else -2,
            order=[snapshot.ids[i] for i in concluded.order],
            granted=[reservation.vehicle for reservation in concluded.grants.given],
            refused=concluded.grants.refused,
            withdrawn=len(picture.withdrawn),
            delay_s=winner.delay if winner is not None else 0.0,
            elapsed_ms=elapsed_ms,
            stages_ms=dict(self._stages),
            qp_solved_total=counts.solved,
            qp_failed_total=counts.failed,
            qp_late_total=counts.late,
            missed_total=self.missed,
            received_total=self._tracker.received,
            rejected_total={str(reason): n for reason, n in (self._tracker.rejected + self.unread).items()},
            fallback=self._tracker.fallbacks,
            silent=int(np.count_nonzero(snapshot.silent)),
            dropped_total=self._pace.dropped,
            unsolved_total=self._pace.unsolved,
        )

    def _log(self, settled: Settled, events: Sequence[Event], picture: Picture, snapshot: Snapshot) -> None:
        """What should not happen is said once per control cycle; what happens all the time is not."""
        intruding = [snapshot.ids[i] for i in np.flatnonzero(picture.limits.phase == INTRUDING)]
        _say("warning", "vehicles lost", [event.vehicle for event in events if event.kind == "lost"])
        _say("info", "vehicles left out", [event.vehicle for event in events if event.kind == "stale"])
        _say("info", "clearances lapsed", [lapsed.vehicle for lapsed in settled.lapsed])
        _say("warning", "in the zone without a clearance", intruding)
        _say("warning", "strayed from their profiles", picture.strayed)
        _say("warning", "clearances withdrawn", picture.withdrawn)
        refused = self._tracker.rejected["overload"]
        if refused > self._refused:
            if snapshot.cycle > self._refusing_until:
                log.warning("vehicles refused", vehicles=len(snapshot))
            self._refused, self._refusing_until = refused, snapshot.cycle + QUIET_CYCLES


def _say(level: str, what: str, vehicles: Sequence[str]) -> None:
    """One line, however many there are: a line each would take longer than the control cycle has."""
    if vehicles:
        getattr(log, level)(what, vehicles=len(vehicles), first=vehicles[:NAMED])
