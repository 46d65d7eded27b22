"""Warm worker processes that solve the candidates of a control cycle side by side.

Theory of operation. A call hands every free worker one batch; workers answer job by job. Where jobs can be weighed,
this process takes its share of them, too (`shares`): small ones are done sooner than sent. What is not there by
the deadline is late and is dropped when it comes: answers carry the number of their call. A worker that still
owes answers is busy and gets nothing new. A worker that dies costs what it owed and is replaced in the
background. Without a deadline (lock-step) nothing may depend on luck: a call waits for all workers first, and
what a dead worker owed goes to its replacement, only the job it died on being given up at the second death.
So the results are the same for any number of workers, 0 included, where jobs are solved in this process.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic, TypeVar

from gameopt_im.solver import worker
from gameopt_im.solver.process import PoolError, Worker
from gameopt_im.solver.shares import share_out
from gameopt_im.solver.worker import Answer, Batch, Start

Job = TypeVar("Job")
Result = TypeVar("Result")

RESTART_PAUSE_S = 1.0
"""Least time between two attempts to replace workers that do not come up."""
ATTEMPTS = 2
"""Without a deadline a job is given up when workers have died on it this often."""


@dataclass(slots=True)
class Counts:
    """Jobs by outcome, and workers lost, since the pool was made."""

    solved: int = 0
    failed: int = 0
    late: int = 0
    lost_workers: int = 0


class _Call(Generic[Job, Result]):
    """One `solve`: its jobs, what has come, the places still open, and how often a worker died on each."""

    def __init__(self, number: int, until_s: float | None, jobs: Sequence[Job], done: asyncio.Future[None]) -> None:
        self.number, self.until_s, self.jobs, self.done = number, until_s, jobs, done
        self.results: list[Result | None] = [None] * len(jobs)
        self.open = set(range(len(jobs)))
        self.deaths: Counter[int] = Counter()
        if not jobs:
            done.set_result(None)

    def settle(self, place: int, result: Result | None) -> None:
        """Put the result of one job in its place; the call is done when none is open."""
        self.results[place] = result
        self.open.discard(place)
        if not self.open and not self.done.done():
            self.done.set_result(None)


class Pool(Generic[Job, Result]):
    """`workers` processes that apply the importable function `solve` ("package.module:name") to jobs.

    Jobs and results are pickled; the `warm_up` jobs are solved by each worker before it counts as started.
    `weigh` says how long a job takes, in units of which the way to a worker takes `shares.SENDING`; without it workers
    do all. Workers `go_first` before other processes, where the system lets them. With `workers` = 0 everything happens
    in this process. Use as an async context, or `start` and `close`.
    """

    def __init__(
        self,
        workers: int,
        solve: str,
        warm_up: Sequence[Any] = (),
        weigh: Callable[[Job], float] | None = None,
        go_first: bool = False,
    ) -> None:
        self.counts = Counts()
        self.last_fault: str | None = None
        """The traceback of the last job that raised."""
        self._size = workers
        self._start = Start(solve, tuple(warm_up), go_first)
        self._weigh = weigh
        self._here: Callable[[Job], Result | None] | None = None
        self._workers: list[Worker] = []
        self._call: _Call[Job, Result] | None = None
        self._number = 0
        self._replacing: set[asyncio.Task[None]] = set()
        self._not_before_s = 0.0
        self._changed = asyncio.Event()
        self._closing = False

    async def start(self) -> None:
        """Start and warm up all workers; raises PoolError where one does not come up."""
        if self._size == 0 or self._weigh is not None:
            self._here = worker.prepare(self._start)
        outcomes = await asyncio.gather(*(self._add() for _ in range(self._size)), return_exceptions=True)
        for error in outcomes:
            if isinstance(error, BaseException):
                await self.close()
                raise error

    async def close(self) -> None:
        """End all workers; what they still owed is dropped."""
        self._closing = True
        for task in self._replacing:
            task.cancel()
        await asyncio.gather(*self._replacing, return_exceptions=True)
        for each in self._workers:
            each.stop()
        self._workers.clear()

    async def __aenter__(self) -> Pool[Job, Result]:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def solve(self, jobs: Sequence[Job], deadline_s: float | None = None) -> list[Result | None]:
        """The result of each job, None for what failed or was not there by `deadline_s`.

        `deadline_s` is absolute, on the loop's clock; None waits for every job. One call at a time.
        """
        if self._call is not None:
            raise RuntimeError("the pool is already solving")
        loop = asyncio.get_running_loop()
        until_s = None if deadline_s is None else time.monotonic() + deadline_s - loop.time()
        self._number += 1
        call = self._call = _Call[Job, Result](self._number, until_s, jobs, loop.create_future())
        try:
            self._mend()
            if until_s is None:
                await self.idle()
            await self._hand_out(call)
            if call.open:
                async with asyncio.timeout_at(deadline_s):
                    await call.done
        except TimeoutError:
            self.counts.late += len(call.open)
        finally:
            self._call = None
        return call.results

    async def idle(self) -> None:
        """Wait until no worker owes an answer and none is being replaced."""
        while self._replacing or any(each.owes for each in self._workers):
            self._changed.clear()
            await self._changed.wait()

    async def _hand_out(self, call: _Call[Job, Result]) -> None:
        """One batch for each free worker, and the rest to this process; without `weigh` that has none of its own.

        Between its own jobs the loop has its turn: it writes what does not fit into a socket at once.
        """
        free = [each for each in self._workers if not each.owes]
        here, *shares = self._shares(call.jobs, len(free))
        for each, places in zip(free, shares, strict=True):
            if places:
                self._send(each, call, places)
        for place in here:
            if any(shares):
                await asyncio.sleep(0)
            begun = self._here is not None and (call.until_s is None or time.monotonic() < call.until_s)
            result, fault = worker.run(self._here, call.jobs[place]) if self._here and begun else (None, None)
            self._settle(call, Answer(call.number, place, result, fault, begun or call.until_s is None))

    def _shares(self, jobs: Sequence[Job], free: int) -> list[list[int]]:
        """The places of the jobs that this process and each free worker take."""
        if self._weigh is not None:
            return share_out([self._weigh(job) for job in jobs], free)
        places = list(range(len(jobs)))
        return [places] if not free else [[], *(places[first::free] for first in range(free))]

    def _send(self, to: Worker, call: _Call[Job, Result], places: Sequence[int]) -> None:
        to.send(Batch(call.number, call.until_s, places, [call.jobs[place] for place in places]))

    def _take(self, answer: Answer) -> None:
        self._changed.set()
        if self._call is not None and answer.number == self._call.number:
            self._settle(self._call, answer)

    def _settle(self, call: _Call[Job, Result], answer: Answer) -> None:
        """Put an answer in its place and count it."""
        nothing = answer.result is None and answer.fault is None
        if not answer.begun or (nothing and call.until_s is not None and time.monotonic() >= call.until_s):
            self.counts.late += 1
        elif answer.result is None:
            self.counts.failed += 1
            self.last_fault = answer.fault or self.last_fault
        else:
            self.counts.solved += 1
        call.settle(answer.place, answer.result)

    async def _add(self) -> Worker:
        added = Worker(self._take, self._lost)
        await added.start(self._start)
        if not added.alive:
            added.stop()
            raise PoolError("a solver worker ended as soon as it was ready")
        self._workers.append(added)
        return added

    def _lost(self, gone: Worker) -> None:
        if self._closing or gone not in self._workers:
            return
        self._workers.remove(gone)
        gone.stop()
        self.counts.lost_workers += 1
        call = self._call
        owed = [place for number, place in gone.owes if call is not None and number == call.number]
        if call is not None and owed:
            owed = self._give_up(call, owed)
        self._replace(call, owed)

    def _give_up(self, call: _Call[Job, Result], owed: list[int]) -> list[int]:
        """Count what is lost with a worker that owed these places; returns those to be tried again.

        It died on the first of them. By the wall clock there is no time for another try.
        """
        call.deaths[owed[0]] += 1
        lost = owed if call.until_s is not None else owed[: call.deaths[owed[0]] // ATTEMPTS]
        for place in lost:
            self._settle(call, Answer(call.number, place, None, None, begun=True))
        return owed[len(lost) :]

    def _mend(self) -> None:
        """Try again for workers whose replacement did not come up."""
        missing = self._size - len(self._workers) - len(self._replacing)
        if asyncio.get_running_loop().time() >= self._not_before_s:
            for _ in range(missing):
                self._replace(None, [])

    def _replace(self, call: _Call[Job, Result] | None, owed: list[int]) -> None:
        task = asyncio.get_running_loop().create_task(self._replacement(call, owed))
        self._replacing.add(task)
        task.add_done_callback(self._replaced)

    def _replaced(self, task: asyncio.Task[None]) -> None:
        self._replacing.discard(task)
        self._changed.set()

    async def _replacement(self, call: _Call[Job, Result] | None, owed: list[int]) -> None:
        """Start a worker in place of a lost one and give it what that one owed, if it is still wanted."""
        try:
            added = await self._add()
        except (PoolError, OSError):
            self._not_before_s = asyncio.get_running_loop().time() + RESTART_PAUSE_S
            for place in owed:
                if call is not None and call is self._call:
                    self._settle(call, Answer(call.number, place, None, None, begun=True))
            return
        if call is not None and call is self._call and owed:
            self._send(added, call, owed)
