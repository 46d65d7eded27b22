"""Keeping a control cycle within its time under the wall clock; in lock-step everything is done, whatever it takes."""

from __future__ import annotations

import structlog

from gameopt_im.core import budget
from gameopt_im.core.budget import Costs, Done, Effort, Ladder, Load, Took
from gameopt_im.options import ServeOptions

log = structlog.get_logger()


class Pace:
    """How much each control cycle tries, from what the ones before it took.

    `dropped` counts the candidates left out for want of time, `unsolved` the control cycles whose programs were.
    """

    def __init__(self, options: ServeOptions) -> None:
        self.dropped = self.unsolved = 0
        parameters = options.parameters
        several = parameters.interlock.ask != "standing"  # the stop sign has one order
        vectors = min(options.candidates, len(parameters.auction.weights)) if several else 1
        incumbent = options.profile == "default" and parameters.planner.incumbent
        self._beside = int(incumbent)
        self._top = vectors + self._beside
        self._programs = parameters.program.solve
        self._budget_s, self._prompt_s = parameters.service.budget_s, parameters.service.prompt_s
        self._costs = self._usual = Costs()
        self._ladder = Ladder(self._top)
        self._slow = 1.0
        """How many times as long as usual everything takes in this control cycle."""
        self._load: Load | None = None
        """What there is to do in this control cycle; None where everything is tried."""
        self._level = self._sequences = self._top
        self._left_s = self._limit_s = float("inf")
        self._elapsed_s = self._shared_s = self._allowed_s = 0.0

    def effort(self, load: Load, elapsed_s: float, left_s: float | None, snapshot_s: float = 0.0) -> Effort:
        """What to try, `elapsed_s` after the beginning, which had `left_s` to the next grid point; None: everything.

        `snapshot_s` is how much of `elapsed_s` the snapshot took.
        """
        self._load, self._level, self._sequences = None, self._top, self._top
        if left_s is None or (self._top == 1 and not self._programs):  # or there is nothing to leave out
            return self._trying()
        before = self._ladder.level
        # What happens once, a late beginning or a process held up, says nothing about the next control cycle.
        steady_s, self._elapsed_s = min(elapsed_s, self._elapsed_s), elapsed_s
        self._ladder = budget.step(self._ladder, self._costs, load, self._budget_s - steady_s, self._top)
        self._say(before, load)
        limit_s = budget.limit_s(self._usual, load, self._top, steady_s, self._prompt_s)
        self._left_s, self._limit_s = min(self._budget_s, left_s) - elapsed_s, limit_s - elapsed_s
        self._load, self._shared_s = load, 0.0
        self._slow = budget.slowness(load.present * self._usual.snapshot, snapshot_s)
        return self._fitting(load)

    def still(self, elapsed_s: float) -> Effort:
        """What of that there is time for, `elapsed_s` after `effort`, with all that sequences share worked out."""
        if self._load is None:
            return self._trying()
        self._shared_s = elapsed_s
        usual_s = self._load.planned * self._usual.shared
        self._slow = max(self._slow, budget.slowness(usual_s, elapsed_s))
        return self._fitting(self._load)

    def _fitting(self, load: Load) -> Effort:
        """What fits of what was to be tried until now, into the time there was when `effort` was asked."""
        costs, usual = self._costs.times(self._slow), self._usual.times(self._slow)
        within = budget.fitting(costs, load, self._left_s, self._top)
        level = min(self._ladder.level, self._level, within, budget.fitting(usual, load, self._limit_s, self._top))
        sequences = level or budget.without_programs(costs, load, min(self._left_s, self._limit_s), self._top)
        sequences = min(sequences, self._sequences)
        if load.uncleared:
            self.dropped += self._sequences - sequences
            self.unsolved += self._programs and level == budget.UNSOLVED < self._level
        self._level, self._sequences = level, sequences
        return self._trying()

    def _trying(self) -> Effort:
        return Effort(self._sequences - self._beside, self._level > budget.UNSOLVED)

    def deadline_s(self, elapsed_s: float, most_s: float) -> float:
        """How long the programs may take that begin `elapsed_s` after `effort`: what follows has its time, too."""
        if self._load is None:
            return most_s
        left_s = self._left_s - self._slow * budget.rest_s(self._costs, self._load)
        limit_s = self._limit_s - self._slow * budget.rest_s(self._usual, self._load)
        theirs_s = budget.programs_limit_s(self._usual, self._load, self._prompt_s)
        self._allowed_s = min(most_s, theirs_s, max(min(left_s, limit_s) - elapsed_s, 0.0))
        return self._allowed_s

    def learn(self, took: Took, begun: int, ready: int, late: bool) -> None:
        """What it took, for the next control cycle; of the programs `begun` some were `ready`; some were `late`."""
        load = self._load
        if load is None:
            return
        if not ready and late:  # workers that are still busy with older ones give up at once
            took = took._replace(programs=max(took.programs, self._allowed_s))
        elif not ready:
            begun = 0  # that they have no solution says nothing about how long one takes
        done = Done(self._sequences if load.uncleared else 0, begun, ready)
        took = took._replace(shared=self._shared_s).over(self._slow)
        self._costs = budget.learned(self._costs, load, done, took)
        self._usual = budget.accustomed(self._usual, load, done, took)

    def _say(self, before: int, load: Load) -> None:
        """Once per change."""
        level = self._ladder.level
        if level == before:
            return
        tell = log.warning if level < before else log.info
        tell(
            "short of time" if level < before else "time to spare",
            sequences=level or "as many as fit",
            of=self._top,
            programs=level > budget.UNSOLVED,
            vehicles=load.vehicles,
        )
