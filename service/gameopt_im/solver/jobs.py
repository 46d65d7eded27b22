"""What a worker is asked to solve, and the one function that solves it (`Pool`'s dotted path)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gameopt_im.core import program
from gameopt_im.core.parameters import Program
from gameopt_im.core.program import QP, Traffic
from gameopt_im.core.residuals import objective
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_im.solver.workspace import kept_workspace, pattern
from gameopt_wire.messages import STEP_S

SOLVE = "gameopt_im.solver.jobs:solve"
"""Dotted path of `solve`, as `Pool` wants it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Speeds (n,) in m/s, the objective reached (slack penalties included) and the primal residual (m/s)."""

    speeds: Floats
    objective: float
    residual: float


class Job(Protocol):
    """A candidate to be solved; it carries all it needs and depends on no other."""

    def solve(self) -> Outcome | None:
        """The outcome, None where no solution meets the residual."""
        ...


def solve(job: Job) -> Outcome | None:
    """Solve one job, in whatever process this is called."""
    return job.solve()


@dataclass(frozen=True, slots=True)
class PaperJob:
    """The paper's program for one candidate sequence: `order` (n,) of `vehicles`, `conflict` (M, M)."""

    vehicles: Traffic
    order: Ints
    conflict: Bools
    parameters: Program

    def program(self) -> tuple[QP, Floats]:
        """The program, and where to start: at the speeds driven, so from the snapshot alone."""
        vehicles, settings = self.vehicles, self.parameters
        rear_end = program.rear_end_rows(vehicles, settings.rear_gap_m, STEP_S)
        lateral = program.lateral_rows(
            vehicles,
            self.order,
            self.conflict,
            settings.lateral_margin_m,
            STEP_S,
            reduced=settings.lateral_rows == "reduced",
        )
        qp = program.assemble(vehicles, settings.lambda_, STEP_S, rear_end, lateral)
        start = np.clip(vehicles.v, *program.boxes(vehicles, STEP_S))
        return qp, np.concatenate([start, program.violations(program.join(rear_end, lateral), start)])

    def solve(self) -> Outcome | None:
        """The one-step speeds."""
        vehicles = self.vehicles
        if not len(vehicles):
            return Outcome(np.zeros(0), 0.0, 0.0)
        qp, start = self.program()
        solution = kept_workspace(residual_mps=self.parameters.residual_mps).solve(pattern(qp), qp, start)
        if solution is None:
            return None
        speeds = np.clip(solution.x[: len(vehicles)], *program.boxes(vehicles, STEP_S))
        return Outcome(speeds, objective(qp, solution.x), solution.residual)


def warm_up() -> list[Job]:
    """Small jobs of every kind: solving them makes a worker load all it will need."""
    one, two = np.ones(2), np.arange(2)
    vehicles = Traffic(
        s=np.array([50.0, 100.0]),
        v=10.0 * one,
        length=5.0 * one,
        a_max=2.6 * one,
        b_max=4.5 * one,
        v_max=20.0 * one,
        speed_priority=one,
        variation_priority=one,
        movement=two,
        lane=two,
    )
    return [PaperJob(vehicles, two, ~np.eye(2, dtype=np.bool_), Program())]
