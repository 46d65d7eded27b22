"""The service's programs as states to compare on: as the service solves them, by OSQP, and by other solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gameopt_im.benchmarks import solvers
from gameopt_im.benchmarks.moments import Moment
from gameopt_im.benchmarks.pairs import Ratio, Timed, in_turn, ratio, timed
from gameopt_im.benchmarks.solvers import Solve
from gameopt_im.core import horizon
from gameopt_im.core.active_set import PlatoonSolution
from gameopt_im.core.program import QP
from gameopt_im.core.residuals import objective, residual
from gameopt_im.core.snapshot import Floats
from gameopt_im.solver.horizon_job import HorizonJob, PlatoonJob
from gameopt_im.solver.jobs import PaperJob
from gameopt_im.solver.workspace import Workspace, kept_workspace, pattern

CLOSE = 1e-3
"""An objective may be off by this, relative to the exact one."""
EXACT_MPS, EXACT_ITERATIONS = 1e-5, 200_000
"""How exactly answers are checked: OSQP again, far beyond what a control cycle asks for."""
SERVICE = "service"
COLD = "OSQP set up for every program / kept, horizon programs"
SPLITTING = "OSQP, kept / active set, horizon programs"

Answers = Sequence[Floats | None]
"""The solution x (nx,) of each program; None where there is none."""


@dataclass(frozen=True, slots=True)
class Programs:
    """Programs solved one after the other as one state.

    `exact` is the least objective of all together, with the `constant` that their `qps` leave out. `solve` is the
    service's way. Where the programs are its own, `platoons` are its jobs, and `others` those that its workspaces
    solved last, which goes off the clock.
    """

    qps: Sequence[QP]
    exact: float
    residual_mps: float
    solve: Callable[[], Answers]
    platoons: Sequence[PlatoonJob] = ()
    others: Sequence[PlatoonJob] = ()
    constant: float = 0.0

    def wrong(self, answers: Answers) -> str | None:
        """What is wrong with them; None for nothing."""
        found = [answer for answer in answers if answer is not None]
        if len(found) < len(self.qps):
            return "no solution"
        worst = max((residual(qp, x) for qp, x in zip(self.qps, found, strict=True)), default=0.0)
        if not worst <= self.residual_mps:
            return f"residual {worst:.1e} m/s"
        reached = self.constant + sum(objective(qp, x) for qp, x in zip(self.qps, found, strict=True))
        off = abs(reached - self.exact) / (1.0 + abs(self.exact))
        return None if off <= CLOSE else f"objective off by {off:.1e}"


def horizon_programs(moments: Sequence[Moment]) -> list[Programs]:
    """The platoons of the candidate that each control cycle solved first."""
    jobs = [min(moment.caught.jobs, key=lambda job: job.stake.cost(0.0)) for moment in moments]
    made = (_horizon(job, before) for before, job in zip(jobs[-1:] + jobs[:-1], jobs, strict=True))
    return [programs for programs in made if programs is not None]


def _horizon(job: HorizonJob, before: HorizonJob) -> Programs | None:
    """None where the exact solution is not found."""
    platoons = job.programs()
    qps = [horizon.program(platoon.values, platoon.blocks)[0] for platoon in platoons]
    exact = _exact(qps)
    if exact is None:
        return None
    constant = horizon.objective(job.task, job.rules, np.zeros((len(job.slots), len(job.rules.blocks))))
    # Kept workspaces of every size are there, and solved another control cycle's programs last.
    others = [*platoons, *before.programs()]
    return Programs(
        qps, constant + exact, job.residual_mps, lambda: _answers(job.solve() for job in platoons), platoons, others,
        constant,
    )  # fmt: skip


def paper_programs(jobs: Iterator[PaperJob]) -> list[Programs]:
    """The programs of these; OSQP is set up for each, since hardly any has the pattern of another."""
    made = []
    for job in jobs:
        qp, start = job.program()
        exact = _exact([qp])
        if exact is not None:
            residual = job.parameters.residual_mps
            made.append(Programs([qp], exact, residual, _cold_paper(qp, start, residual)))
    return made


def _cold_paper(qp: QP, start: Floats, residual_mps: float) -> Callable[[], Answers]:
    def solve() -> Answers:
        solution = Workspace(residual_mps=residual_mps).solve(pattern(qp), qp, start)
        return [None if solution is None else solution.x]

    return solve


def solver_ratios(traffic: str, name: str, by: str, states: Sequence[Programs]) -> list[Ratio]:
    """Other solvers against the service, which solves `by`, on the same programs; a line for each not installed."""
    there = {solver: solve for solver, solve in solvers.OPTIONAL.items() if solvers.installed(solver)}
    ways = {solver: _other(solve) for solver, solve in there.items()}
    times = in_turn(states, {SERVICE: _service, **ways})
    return [
        ratio(traffic, f"{solver} / {by}, {name}", times[solver], times[SERVICE])
        if solver in there
        else Ratio(traffic, f"{solver} / {by}, {name}", 0, failed=f"not installed: {solvers.EXTRA}")
        for solver in solvers.OPTIONAL
    ]


def osqp_ratios(traffic: str, states: Sequence[Programs]) -> list[Ratio]:
    """OSQP with kept workspaces against the service, and set up for every program against kept workspaces.

    Of the latter the answers are the same, bit for bit.
    """
    times = in_turn(states, {SERVICE: _service, SPLITTING: _splitting, COLD: _set_up})
    return [
        ratio(traffic, SPLITTING, times[SPLITTING], times[SERVICE]),
        ratio(traffic, COLD, times[COLD], times[SPLITTING]),
    ]


def _service(state: Programs) -> Timed:
    for job in state.others:
        job.solve()
    return timed(state.solve, state.wrong)


def _splitting(state: Programs) -> Timed:
    for job in state.others:
        job.by_splitting()
    return timed(lambda: _answers(job.by_splitting() for job in state.platoons), state.wrong)


def _set_up(state: Programs) -> Timed:
    """With nothing kept from one program to the next."""
    return timed(lambda: _answers(_without_kept(job) for job in state.platoons), state.wrong)


def _other(solve: Solve) -> Callable[[Programs], Timed]:
    return lambda state: timed(lambda: [solve(qp) for qp in state.qps], state.wrong)


def _without_kept(job: PlatoonJob) -> PlatoonSolution | None:
    kept_workspace.cache_clear()
    return job.by_splitting()


def _answers(solutions: Iterable[PlatoonSolution | None]) -> Answers:
    return [None if solution is None else solution.u.ravel() for solution in solutions]


def _exact(qps: Sequence[QP]) -> float | None:
    """The least objective of all programs together; None where it is not found."""
    found = [Workspace(residual_mps=EXACT_MPS, max_iter=EXACT_ITERATIONS).solve(pattern(qp), qp) for qp in qps]
    if not all(found):
        return None
    return sum(objective(qp, each.x) for qp, each in zip(qps, found, strict=True) if each)
