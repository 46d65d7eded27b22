"""Solving as many of a control cycle's horizon programs as the choice of q* needs, most often one.

Theory of operation. A candidate's cost is known but for J, and J counts for little beside the delay. So the one that
would cost least with J = 0 is solved first. Another is worth solving only if it may still come out cheaper, and its J
is bounded from below by weak duality, with the first one's multipliers and its own corridor. What is left out could
not have been chosen: the winner and its speeds are those of solving all, and since nothing but the first result
decides what is left out, they are the same for any number of workers. If the first has no solution all are tried.
Platoons share no row, so a candidate's are programs of their own, solved side by side.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import Any, Self, TypeAlias

import numpy as np

from gameopt_im.core.active_set import PlatoonSolution
from gameopt_im.core.parameters import Parameters
from gameopt_im.solver import horizon_job, jobs
from gameopt_im.solver.horizon_job import HorizonJob, HorizonOutcome, PlatoonJob, WarmUp
from gameopt_im.solver.pool import Counts, Pool
from gameopt_wire.messages import Profile

ROUNDING = 1e-9
"""Costs this close, relative to their size, count as equal: sums may differ by their order."""


class Contest:
    """Solves candidates on a pool, whose workers share their platoons.

    `counts` are those of the platoons' programs; what was not worth solving is in none of them.
    """

    def __init__(self, workers: int, parameters: Parameters | None = None, go_first: bool = False) -> None:
        self._example = horizon_job.warm_up(parameters or Parameters())
        warm_up = [WarmUp(each) for each in self._example.programs()]
        self._pool = Pool[PlatoonJob, PlatoonSolution](workers, jobs.SOLVE, warm_up, PlatoonJob.weight, go_first)

    @property
    def counts(self) -> Counts:
        """Programs solved, failed and late since the contest was made, and workers lost."""
        return self._pool.counts

    async def __aenter__(self) -> Self:
        """Start and warm up all workers, and what this process judges candidates with."""
        horizon_job.least_costs(
            [self._example], np.zeros((len(self._example.slots), 4, len(self._example.rules.blocks)))
        )
        await self._pool.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._pool.close()

    async def solve(
        self, candidates: Sequence[HorizonJob], deadline_s: float | None = None
    ) -> list[HorizonOutcome | None]:
        """The outcomes of the candidates that may win; None for what failed, was late or was not worth solving."""
        results: list[HorizonOutcome | None] = [None] * len(candidates)
        if not candidates:
            return results
        known: Solutions = {}
        first = min(range(len(candidates)), key=lambda k: candidates[k].stake.cost(0.0))
        (results[first],) = await self._solved([candidates[first]], known, deadline_s)
        left = _contenders(candidates, first, results[first]) if _in_time(deadline_s) else []
        if not (left and _in_time(deadline_s)):
            return results
        outcomes = await self._solved([candidates[k] for k in left], known, deadline_s)
        for k, outcome in zip(left, outcomes, strict=True):
            results[k] = outcome
        return results

    async def _solved(
        self, candidates: Sequence[HorizonJob], known: Solutions, deadline_s: float | None
    ) -> list[HorizonOutcome | None]:
        """The outcomes of these; platoons that were `known` before are not solved again.

        That a platoon has no solution is known only if none was late or lost: then another try may find it.
        """
        until_s = None if deadline_s is None else time.monotonic() + deadline_s - _now()
        fresh: dict[Met, PlatoonJob] = {}
        all_met = [candidate.met() for candidate in candidates]
        for candidate, met in zip(candidates, all_met, strict=True):
            hopeless = any(key in known and known[key] is None for key in met)
            missing = {key for key in met if key not in known and key not in fresh}
            if missing and not hopeless:
                fresh |= {key: job for key, job in zip(met, candidate.programs(until_s), strict=True) if key in missing}
        missed = self._missed()
        solved = dict(zip(fresh, await self._pool.solve(list(fresh.values()), deadline_s), strict=True))
        certain = self._missed() == missed
        known.update({key: solution for key, solution in solved.items() if certain or solution is not None})
        solved = known | solved
        return [
            candidate.joined([solved.get(key) for key in met])
            for candidate, met in zip(candidates, all_met, strict=True)
        ]

    def _missed(self) -> int:
        return self.counts.late + self.counts.lost_workers


Met: TypeAlias = tuple[int, bytes]
Solutions: TypeAlias = dict[Met, PlatoonSolution | None]
"""The solutions of a control cycle's platoons, by their slots."""


def _now() -> float:
    return asyncio.get_running_loop().time()


def _in_time(deadline_s: float | None) -> bool:
    return deadline_s is None or _now() < deadline_s


def _contenders(candidates: Sequence[HorizonJob], first: int, outcome: HorizonOutcome | None) -> list[int]:
    """Which of the others may still cost less than the first one's outcome, or as much."""
    others = [k for k in range(len(candidates)) if k != first]
    if outcome is None:
        return others
    cost = candidates[first].stake.cost(outcome.objective)
    limit = cost + ROUNDING * (1.0 + abs(cost))
    cheap = [k for k in others if candidates[k].stake.cost(0.0) <= limit]
    if not cheap:
        return []
    least = horizon_job.least_costs([candidates[k] for k in cheap], outcome.duals)
    return [k for k, cost_at_least in zip(cheap, least, strict=True) if cost_at_least <= limit]


Solver: TypeAlias = Contest | Pool[Any, Any]
"""Whatever solves the programs of a control cycle; an async context."""


def solver_for(profile: Profile, workers: int, parameters: Parameters, go_first: bool = False) -> Solver:
    """The solver of a profile, warmed on its programs; its workers `go_first` where the system lets them."""
    if profile == "default":
        return Contest(workers, parameters, go_first)
    return Pool(workers, jobs.SOLVE, jobs.warm_up(), go_first=go_first)
