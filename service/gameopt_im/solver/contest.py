"""A pool that solves as many of a control cycle's horizon programs as the choice of q* needs, most often one.

Theory of operation. A candidate's cost is known but for J, and J counts for little beside the delay. So the one that
would cost least with J = 0 is solved first. Another is worth solving only if it may still come out cheaper, and its J
is bounded from below by weak duality, with the first one's multipliers and its own corridor. What is left out could
not have been chosen: the winner and its speeds are those of solving all, and since nothing but the first result
decides what is left out, they are the same for any number of workers. If the first has no solution all are tried.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

import numpy as np

from gameopt_im.solver import horizon_job, jobs
from gameopt_im.solver.horizon_job import HorizonJob, HorizonOutcome
from gameopt_im.solver.pool import Pool
from gameopt_wire.messages import Profile

ROUNDING = 1e-9
"""Costs this close, relative to their size, count as equal: sums may differ by their order."""


class Contest(Pool[HorizonJob, HorizonOutcome]):
    """`Pool.solve` gives None for what failed, was late or was not worth solving; only the first two are counted."""

    async def start(self) -> None:
        """Start and warm up all workers, and what this process judges candidates with."""
        await super().start()
        for job in horizon_job.warm_up():
            job.may_cost(np.zeros((len(job.slots), 4, len(job.rules.blocks))))

    async def solve(self, jobs: Sequence[HorizonJob], deadline_s: float | None = None) -> list[HorizonOutcome | None]:
        """The outcomes of the candidates that may win."""
        results: list[HorizonOutcome | None] = [None] * len(jobs)
        if not jobs:
            return results
        first = min(range(len(jobs)), key=lambda k: jobs[k].stake.cost(0.0))
        (results[first],) = await super().solve([jobs[first]], deadline_s)
        left = [k for k in _contenders(jobs, first, results[first]) if deadline_s is None or _now() < deadline_s]
        for k, result in zip(left, await super().solve([jobs[k] for k in left], deadline_s), strict=True):
            results[k] = result
        return results


def _now() -> float:
    return asyncio.get_running_loop().time()


def _contenders(jobs: Sequence[HorizonJob], first: int, outcome: HorizonOutcome | None) -> list[int]:
    """Which of the others may still cost less than the first one's outcome, or as much."""
    others = [k for k in range(len(jobs)) if k != first]
    if outcome is None:
        return others
    cost = jobs[first].stake.cost(outcome.objective)
    limit = cost + ROUNDING * (1.0 + abs(cost))
    return [k for k in others if jobs[k].stake.cost(0.0) <= limit and jobs[k].may_cost(outcome.end.duals) <= limit]


def pool_for(profile: Profile, workers: int) -> Pool[Any, Any]:
    """The workers of a profile, warmed on its programs."""
    if profile == "default":
        return Contest(workers, jobs.SOLVE, horizon_job.warm_up())
    return Pool(workers, jobs.SOLVE, jobs.warm_up())
