"""When a control cycle begins: on an absolute 100 ms grid of the epoch, or when the simulator says so.

Both clocks hand out a `Tick`: the control cycle, its time and every message that arrived for it.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from gameopt_im.inbox import Raw, split_steps
from gameopt_wire import codec
from gameopt_wire.messages import STEP_S, Step

CYCLES_PER_S = round(1 / STEP_S)
MAX_HELD = 100_000
"""Messages that wait for a step at most; beyond that the newest, for a step may never come."""
READ_EVERY_S = 0.001
"""From the grid point on what has come is read this often, until everybody is heard."""
LONGEST_WAIT_S = 2.0 * STEP_S + 1e-6
"""A longer wait than this for the next control cycle means that the clock has been set back."""


class Source(Protocol):
    """Where messages come from; the bus is one."""

    def drain(self) -> list[Raw]:
        """All messages since the last call, in the order they came."""

    async def arrival(self) -> None:
        """Returns once there is something to drain."""

    def call_roll(self, whom: Collection[str], since_s: float) -> None:
        """From now on waits for a state under each of these keys, from `since_s` of the epoch."""

    async def all_heard(self, most_s: float) -> bool:
        """Returns once everybody called has been heard, or False after `most_s`."""


class Tick(NamedTuple):
    """The beginning of a control cycle; `restarted` says that lock-step time has begun anew.

    `left_s` is the time to the next grid point, where the vehicles will want their commands; None in lock-step.
    The first `ahead` of the messages were read while the others were waited for.
    """

    cycle: int
    time_s: float
    messages: list[Raw]
    restarted: bool = False
    left_s: float | None = None
    ahead: int = 0


class Upcoming(NamedTuple):
    """The next control cycle and how many were missed before it."""

    cycle: int
    missed: int


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid: control cycle k is for time k * 100 ms of the epoch and is due `collect_s` after it.

    Positions are computed from k alone, never from the previous tick, so they cannot drift.
    """

    collect_s: float = 0.0

    def time_s(self, cycle: int) -> float:
        """The grid point of a control cycle."""
        return cycle / CYCLES_PER_S

    def due_s(self, cycle: int) -> float:
        """When its decision begins."""
        return self.time_s(cycle) + self.collect_s

    def after(self, now_s: float, last: int | None) -> Upcoming:
        """The first control cycle after `last` that is still to come at `now_s`.

        Those whose moment has passed are missed; none is made up for. A clock set back by more than a control
        cycle starts anew, or it would stand still until the old time is reached.
        """
        cycle = int((now_s - self.collect_s) * CYCLES_PER_S) - 1
        while self.due_s(cycle) <= now_s:
            cycle += 1
        if last is None or cycle < last:
            return Upcoming(cycle, 0)
        cycle = max(cycle, last + 1)
        return Upcoming(cycle, cycle - last - 1)


class WallClock:
    """Control cycles on the grid of the wall clock; `missed` counts those that never began.

    One begins `collect_s` after its grid point; sooner, once everybody who was heard for the last one has been heard
    again since the grid point. Meanwhile `read` is given what has come, and the time it is for; it returns how many of
    the messages it has read. `late_s` is how long after the later moment the last one began, 0 before it.
    """

    def __init__(
        self,
        source: Source,
        collect_s: float,
        now: Callable[[], float] = time.time,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        read: Callable[[list[Raw], float], int] | None = None,
    ) -> None:
        self.missed = 0
        self.late_s = 0.0
        self.rejected: Counter[str] = Counter()
        self._source = source
        self._grid = Grid(collect_s)
        self._now = now
        self._sleep = sleep
        self._read = read
        self._early: list[Raw] = []
        """What has come since the last control cycle and was given to `read`."""
        self._ahead = 0
        """How many of them it has read."""
        self._last: int | None = None
        self._heard: set[str] = set()
        self._called: int | None = None
        """The control cycle whose states are waited for."""

    async def next_cycle(self) -> Tick:
        """Sleeps until the next control cycle is due."""
        cycle = self._plan()
        while (late_s := self._now() - self._grid.due_s(cycle)) < 0.0 or late_s >= STEP_S:
            if not -LONGEST_WAIT_S <= late_s < 0.0:  # set back, or slept through all of it, as if suspended
                cycle = self._plan()
            elif await self._complete(cycle, -late_s):
                break
        self._last, self.late_s = cycle, max(0.0, late_s)
        messages, ahead = self._early + self._drained(), self._ahead
        self._early, self._ahead = [], 0
        self._heard = {raw.key for raw in messages if raw.kind == "state"}
        self._call_roll(cycle + 1)
        left_s = self._grid.time_s(cycle + 1) - self._now()
        return Tick(cycle, self._grid.time_s(cycle), messages, left_s=left_s, ahead=ahead)

    async def _complete(self, cycle: int, left_s: float) -> bool:
        """Sleeps and reads up to `left_s`; whether there is nobody to wait for any longer.

        The last ones heard are read here, and what has come meanwhile after it: with the states of a burst come bids
        and newcomers, who are not waited for.
        """
        if not self._heard:
            await self._sleep(left_s)
            return False
        begins_s = self._grid.time_s(cycle)
        most_s = max(0.0, begins_s - self._now()) + READ_EVERY_S
        complete = await self._source.all_heard(min(left_s, most_s))
        if complete and (early_s := begins_s - self._now()) > 0.0:
            await self._sleep(early_s)  # everybody has left before the grid point
        if self._read is not None:
            messages = self._drained()
            self._early += messages
            self._ahead += self._read(messages, begins_s)
        return complete

    def _drained(self) -> list[Raw]:
        messages, _ = split_steps(self._source.drain())
        return messages

    def _call_roll(self, cycle: int) -> None:
        """Waits for the states of a control cycle, as soon as that is the next: they may come while one overruns."""
        self._called = cycle
        self._source.call_roll(self._heard, self._grid.time_s(cycle))

    def _plan(self) -> int:
        cycle, missed = self._grid.after(self._now(), self._last)
        self.missed += missed
        self._last = cycle - 1  # all before it are settled
        if cycle != self._called:
            self._call_roll(cycle)
        return cycle


class LockStep:
    """Control cycles when a `Step` has come and so have all the messages it counts, valid or not.

    Whatever else is on the network, as the rest of a simulator that was killed, is taken along uncounted.
    """

    late_s: None = None
    """It has no time to be late for."""

    def __init__(self, source: Source) -> None:
        self.missed = 0
        self.rejected: Counter[str] = Counter()
        self._source = source
        self._messages: list[Raw] = []
        self._step: Step | None = None
        self._last: int | None = None

    async def next_cycle(self) -> Tick:
        """Waits for the simulator."""
        while (tick := self.take(self._source.drain())) is None:
            await self._source.arrival()
        return tick

    def take(self, arrived: list[Raw]) -> Tick | None:
        """Adds what has arrived; the control cycle, once it is complete."""
        messages, steps = split_steps(arrived)
        self._messages += messages
        if (excess := len(self._messages) - MAX_HELD) > 0:
            del self._messages[:excess]
            self.rejected["overflow"] += excess
        for raw in steps:
            try:
                self._step = codec.STEP.decode(raw.payload)  # the newest holds: an older simulator is gone
            except codec.Rejected as rejected:
                self.rejected[rejected.reason] += 1
        step = self._step
        if step is None or sum(_counts(raw, step.cycle) for raw in self._messages) < step.messages:
            return None
        tick = Tick(step.cycle, step.time_s, self._messages, self._last is not None and step.cycle <= self._last)
        self._messages, self._step, self._last = [], None, step.cycle
        return tick


def _counts(raw: Raw, cycle: int) -> bool:
    return raw.kind != "gone" and raw.step in (None, cycle)
