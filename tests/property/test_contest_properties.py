"""What a contest leaves unsolved could not have won, and the bound it goes by is one."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import numpy as np
import pytest
from candidates import PLAY_MPS, RULES, contests, job
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.core import duality, horizon
from gameopt_im.core.horizon import HorizonTask
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.planning import Stake
from gameopt_im.solver import jobs, shares
from gameopt_im.solver.contest import Contest, Solutions
from gameopt_im.solver.horizon_job import HorizonJob, HorizonOutcome
from gameopt_im.solver.pool import Counts, Pool

Solver = Pool[HorizonJob, HorizonOutcome] | Contest


def outcome_of(pool: Solver, made: Sequence[HorizonJob]) -> list[HorizonOutcome | None]:
    async def solve() -> list[HorizonOutcome | None]:
        async with pool:
            return await pool.solve(made)

    return asyncio.run(solve())


def winner(made: Sequence[HorizonJob], outcomes: Sequence[HorizonOutcome | None]) -> tuple[int, bytes] | None:
    costs = [
        (job.stake.cost(outcome.objective), k, outcome.speeds.tobytes())
        for k, (job, outcome) in enumerate(zip(made, outcomes, strict=True))
        if outcome is not None
    ]
    return min(costs)[1:] if costs else None


@given(made=contests())
@settings(max_examples=60)
def test_a_contest_has_the_winner_of_solving_all(made: list[HorizonJob]) -> None:
    everything = outcome_of(Pool(0, jobs.SOLVE), made)
    contest = Contest(0)
    some = outcome_of(contest, made)
    assert winner(made, some) == winner(made, everything)
    assert contest.counts.solved + contest.counts.failed <= sum(len(job.task.counts) for job in made)


@given(made=contests(), seed=st.integers(0, 2**32))
@settings(max_examples=60)
def test_no_solution_is_below_the_bound(made: list[HorizonJob], seed: int) -> None:
    """Whatever the multipliers; and with its own it is close."""
    random = np.random.default_rng(seed)
    for each, outcome in zip(made, outcome_of(Pool(0, jobs.SOLVE), made), strict=True):
        if outcome is None:
            continue
        slots = each.slots[None]
        for duals in (outcome.duals, random.normal(size=outcome.duals.shape)):
            assert duality.least_objectives(each.task, RULES, slots, duals, PLAY_MPS)[0] <= outcome.objective + 1e-9
        own = duality.least_objectives(each.task, RULES, slots, outcome.duals, 0.0)[0]
        assert own == pytest.approx(outcome.objective, rel=1e-9, abs=1e-9)


def test_who_cannot_win_is_not_solved() -> None:
    contest = Contest(0)
    first, second, third = outcome_of(contest, [job([5.0, 7.0], 30.0), job([6.0, 8.0], 10.0), job([9.0, 12.0], 30.0)])
    assert second is not None
    assert first is third is None
    assert contest.counts == Counts(solved=1)


def test_platoons_that_candidates_share_are_solved_once() -> None:
    warm, contest = job([5.0, 7.0], 0.0), Contest(0)
    columns = [getattr(warm.task, name) for name in warm.task.__slots__ if name != "counts"]
    task = HorizonTask((2, 1), *(np.concatenate([column, column[:1]]) for column in columns))
    indifferent = Stake(0.0, 0.0, 0.0)
    made = [
        HorizonJob(task, warm.rules, np.array(slots), PLAY_MPS, indifferent)
        for slots in ([5.0, 7.0, 5.0], [5.0, 7.0, 6.0])
    ]
    assert None not in outcome_of(contest, made)
    assert contest.counts == Counts(solved=3)  # of 4


def test_if_the_favourite_has_no_solution_the_others_are_tried() -> None:
    contest = Contest(0)
    hopeless = job([float("nan"), 7.0], 10.0)
    first, second = outcome_of(contest, [hopeless, job([5.0, 7.0], 30.0)])
    assert first is None
    assert second is not None
    assert contest.counts == Counts(solved=1, failed=1)


@pytest.mark.parametrize("workers", [1, 2])
def test_who_solves_makes_no_difference(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four platoons of ten, and nobody left without."""
    monkeypatch.setattr(shares, "SENDING", 0.0)
    random = np.random.default_rng(3)
    counts, trails = horizon.platoons([10] * 4)
    n, h = 40, len(RULES.blocks)
    s = np.concatenate([np.cumsum(random.uniform(12.0, 40.0, 10)) for _ in range(4)])
    task = HorizonTask(
        counts=counts, s=s, v=random.uniform(5.0, 15.0, n), length=np.full(n, 5.0), a=np.full(n, 2.0),
        b=np.full(n, 4.5), top=np.full(n, 20.0), line_cap=np.full(n, 20.0), ps=np.ones(n), pv=np.ones(n),
        room=np.full((n, h), NEVER), trails=trails,
    )  # fmt: skip
    made = [HorizonJob(task, RULES, s / 12.0 + k, PLAY_MPS, Stake(10.0, 0.01, 0.0)) for k in range(3)]
    assert all(shares.share_out([platoon.weight() for platoon in made[0].programs()], workers))
    alone, together = outcome_of(Contest(0), made), outcome_of(Contest(workers), made)
    assert winner(made, alone) is not None
    assert winner(made, together) == winner(made, alone)


def test_nobody_to_plan_is_no_contest() -> None:
    assert outcome_of(Contest(0), []) == []


def test_what_was_late_may_be_tried_again() -> None:
    """Only that a platoon has no solution is remembered within a control cycle, not that none was found in time."""

    async def known_after(candidate: HorizonJob, late: bool) -> Solutions:
        known: Solutions = {}
        async with Contest(0) as contest:
            await contest._solved([candidate], known, asyncio.get_running_loop().time() - 1.0 if late else None)
        return known

    hopeless = job([float("nan"), 7.0], 10.0)
    assert asyncio.run(known_after(hopeless, late=True)) == {}
    assert list(asyncio.run(known_after(hopeless, late=False)).values()) == [None]
