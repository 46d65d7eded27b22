"""What `gameopt-im bench` compares: numbers of workers, the paper's way against the service's, solvers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np

from gameopt_im.benchmarks import moments, programs
from gameopt_im.benchmarks.moments import Moment
from gameopt_im.benchmarks.pairs import Ratio, Timed, in_turn, ratio, timed
from gameopt_im.core import planning
from gameopt_im.core.budget import Effort
from gameopt_im.core.conflicts import ground
from gameopt_im.options import ServeOptions
from gameopt_im.solver.jobs import Outcome, PaperJob
from gameopt_im.solver.workspace import kept_workspace
from gameopt_im.strategy import PaperProfile, Proposal

SAMPLES = 20
"""Control cycles that are caught for each number of vehicles."""
WORKERS = (0, 1, 2)
SAME_ROWS = "full lateral rows / reduced, the paper's K programs"
LITERAL = "paper taken literally / service, whole decision"


async def compare(options: ServeOptions, vehicles: int, samples: int = SAMPLES) -> list[Ratio]:
    """All ratios on made-up traffic of so many vehicles."""
    workers = sorted({*WORKERS, options.workers})
    watched = await moments.watch(options, vehicles, workers, samples)
    traffic, decisions, caught = f"{vehicles} vehicles", watched.decisions, watched.moments
    paper = _Paper(options)
    horizon = programs.horizon_programs(caught)
    reduced = programs.paper_programs(paper.first_jobs(caught))
    return [
        *(
            ratio(
                traffic,
                f"{count} worker{'s' * (count > 1)} / none, whole decision",
                decisions[str(count)],
                decisions["0"],
            )
            for count in workers
            if count
        ),
        _literal(traffic, caught, paper, options.workers),
        _rows(traffic, caught, paper),
        *programs.osqp_ratios(traffic, horizon),
        *programs.solver_ratios(traffic, "horizon programs", "active set", horizon),
        *programs.solver_ratios(traffic, "the paper's program, reduced rows", "OSQP", reduced),
    ]


class _Paper:
    """The profile `paper` on what the service's control cycles were made of."""

    def __init__(self, options: ServeOptions) -> None:
        self._options = options
        self._ground = ground(options.map, "box", options.parameters.program.lateral_margin_m, options.turn_speed)

    def proposal(self, moment: Moment, rows: str) -> tuple[PaperProfile, Proposal]:
        """Bids, sequences and their programs on `full` or `reduced` lateral rows."""
        program = msgspec.structs.replace(self._options.parameters.program, lateral_rows=rows)
        parameters = msgspec.structs.replace(self._options.parameters, program=program)
        profile = PaperProfile(replace(self._options, parameters=parameters), self._ground)
        snapshot, book, limits = moment.caught.snapshot, moment.caught.book, moment.caught.limits
        who = planning.bidders(snapshot, self._ground, book, limits, parameters, self._options.candidates)
        return profile, profile.propose(snapshot, book, limits, who, (), lambda: Effort(self._options.candidates))

    def first_jobs(self, caught: Sequence[Moment]) -> Iterator[PaperJob]:
        """The first sequence's program on reduced rows, of every moment."""
        for moment in caught:
            yield self.proposal(moment, "reduced")[1].jobs[0]


def _literal(traffic: str, caught: Sequence[Moment], paper: _Paper, workers: int) -> Ratio:
    """The decision with the paper's planning in place of the service's, against the service's own.

    Full rows, one set-up for each candidate, one candidate after the other in one process; one without a solution is
    out. All else, from the snapshot to the interlock, both have in common.
    """
    solved: list[bool] = []

    def plan(moment: Moment) -> list[Outcome | None]:
        profile, proposal = paper.proposal(moment, "full")
        outcomes = [_set_up_and_solved(job) for job in proposal.jobs]
        profile.choose(proposal, outcomes)
        return outcomes

    def wrong(outcomes: list[Outcome | None]) -> str | None:
        solved.extend(outcome is not None for outcome in outcomes)
        return None if any(outcomes) else "no program has a solution"

    first = []
    for moment in caught:
        took = timed(partial(plan, moment), wrong, time.perf_counter)
        first.append(Timed(moment.decision_s - moment.planning_s + took.seconds, took.wrong))
    second = [Timed(moment.decision_s, None) for moment in caught]
    note = f"service with --workers {workers}; {solved.count(False)} of {len(solved)} programs unsolved"
    return ratio(traffic, LITERAL, first, second, note)


def _set_up_and_solved(job: PaperJob) -> Outcome | None:
    kept_workspace.cache_clear()
    return job.solve()


def _rows(traffic: str, caught: Sequence[Moment], paper: _Paper) -> Ratio:
    """All pairs' rows against their transitive reduction: rows and programs made and solved, auction left out.

    A pair is all sequences of a control cycle that have a solution on either. With slack the two are not the same
    program: full rows charge more, which is the note.
    """
    first, second, more, sequences = [], [], [], 0
    for moment in caught:
        jobs = list(zip(*(paper.proposal(moment, rows)[1].jobs for rows in ("full", "reduced")), strict=True))
        found: list[list[Outcome | None]] = [[], []]
        full, reduced = in_turn(
            jobs, {rows: _one_of_two(k, found[k]) for k, rows in enumerate(("full", "reduced"))}
        ).values()
        both = [k for k in range(len(jobs)) if not full[k].wrong and not reduced[k].wrong]
        sequences += len(jobs)
        wrong = None if both else "no sequence has a solution on either"
        first.append(Timed(sum(full[k].seconds for k in both), wrong))
        second.append(Timed(sum(reduced[k].seconds for k in both), wrong))
        more += [a.objective / b.objective for a, b in zip(*found, strict=True) if a and b and b.objective > 0.0]
    note = f"full rows charge {np.median(more):.2f} times as much" if more else "nothing charged"
    return ratio(
        traffic, SAME_ROWS, first, second, f"{note}; {sequences - len(more)} of {sequences} sequences left out"
    )


def _one_of_two(which: int, found: list[Outcome | None]) -> Callable[[tuple[PaperJob, ...]], Timed]:
    """Solves one of a pair of jobs, and keeps what comes of it."""

    def wrong(outcome: Outcome | None) -> str | None:
        found.append(outcome)
        return "no solution" if outcome is None else None

    return lambda jobs: timed(jobs[which].solve, wrong)
