"""What of a control cycle's work fits into its time: what is left out first, and when it comes back.

Theory of operation. The work is a ladder; each level takes in all below it:

    0      slots for one sequence, the incumbent, driven on the approach law
    1      and its program
    1 + k  and k more sequences, by the first k weight vectors, and the program of q*

On level 0 the time that no program can use goes to sequences again, as many as fit (`without_programs`). The interlock
and the commands stand outside of the ladder: they are always worked out. What a level will cost follows from what
earlier control cycles took, measured by whoever calls; no clock is read here. A cost rises at once and falls slowly
(`learned`), and so does the level fall and rise: down as soon as it does not fit, up by one, later to twice as much,
after a number of control cycles with time to spare, a number that doubles whenever the level falls again.

Beside the budget there is what is usual, by running medians (`accustomed`), which no single control cycle moves far. A
control cycle has to fit into `PATIENCE` times its usual time (`limit_s`), and its programs into theirs
(`programs_limit_s`). While the processor is slow (`slowness`), as the snapshot tells, and then what all sequences
share, what is left to do takes as many times longer than usual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from gameopt_wire.messages import STEP_S

UNSOLVED, ALONE = 0, 1
"""Levels: without programs; one sequence with its program."""
HANDFUL = 10
"""What is fixed in a cost is taken to be as much as so many vehicles cost."""
SHARED = 3
"""What all sequences share, bids above all, is taken to cost as much as so many sequences: measured, 260 to 520
vehicles. Without it, one sequence alone would look so dear that the others never came back.
"""
RISE, FALL = 0.5, 0.1
"""Weight of a new measurement that is dearer than the estimate, and of one that is cheaper. Programs end at their
deadline whatever they need, so for them it is always the smaller one: a late one now and then is no reason to stop.
"""
FADE = 0.98
"""An estimate that cannot be renewed falls to this share per control cycle, so that it is tried again some day."""
LATE = 2.0
"""A program that was not ready in its time is taken to need so many times as long."""
SPARE = 0.8
"""The level rises only to what fits into this share of the time."""
PATIENCE, PROGRAMS_PATIENCE = 1.5, 2.0
"""A control cycle, and its programs, may take so many times what they usually take before less is tried for that."""
PROMPT_PROGRAMS = 0.2
"""The share of what counts as prompt for a control cycle that counts as prompt for its programs."""
SLIP = 1.05
"""What is usual goes up or down by this factor a control cycle at the most: in the long run it is the median."""
CALM_CYCLES, MOST_CALM_CYCLES = 5, 320
"""Control cycles with time to spare before the level rises: at first, and after many falls."""


class Load(NamedTuple):
    """The vehicles of a control cycle: all of them, and those without a clearance."""

    vehicles: int
    uncleared: int

    @property
    def present(self) -> int:
        """What costs per vehicle are multiplied by."""
        return self.vehicles + HANDFUL

    @property
    def planned(self) -> int:
        """What costs per uncleared vehicle are multiplied by."""
        return self.uncleared + HANDFUL


class Effort(NamedTuple):
    """What a control cycle tries: the incumbent and so many weight vectors, and whether their programs."""

    candidates: int
    programs: bool = True


Ask: TypeAlias = Callable[[], Effort]
"""Asked for late, it answers by what time has gone until then."""


class Costs(NamedTuple):
    """What it takes, s: one sequence, one program (in what is usual: all of them), and what all sequences share, per
    uncleared vehicle; what comes after the programs, and a snapshot, per vehicle.
    """

    sequence: float = 0.0
    program: float = 0.0
    shared: float = 0.0
    rest: float = 0.0
    snapshot: float = 0.0

    def times(self, slow: float) -> Costs:
        """What it costs while everything takes `slow` times as long."""
        return Costs(*(slow * cost for cost in self))


class Took(NamedTuple):
    """What a control cycle took, s: its sequences, its programs, everything after these, the snapshot before, and of
    the sequences what all of them share.
    """

    sequences: float
    programs: float
    rest: float
    snapshot: float = 0.0
    shared: float = 0.0

    def over(self, slow: float) -> Took:
        """What it would have taken, had not all that was left to do taken `slow` times as long.

        Snapshot and shared part, by which that is told, are left as they are.
        """
        return self._replace(sequences=self.sequences / slow, programs=self.programs / slow, rest=self.rest / slow)


class Done(NamedTuple):
    """What was done in that time: sequences, programs begun, and programs that were ready."""

    sequences: int
    begun: int
    ready: int


class Ladder(NamedTuple):
    """The level, the control cycles it has had time to spare for, and how many it takes to rise.

    `rose` says that the last change was a rise, so that time to spare since then means that it was right.
    """

    level: int
    calm: int = 0
    patience: int = CALM_CYCLES
    rose: bool = True


def slowness(usual_s: float, took_s: float) -> float:
    """How many times as long as usual something took; 1 at the least, and where nothing is known.

    What every control cycle works out in the same way tells how fast the processor is just now.
    """
    return max(1.0, took_s / usual_s) if usual_s else 1.0


def limit_s(usual: Costs, load: Load, top: int, before_s: float, prompt_s: float) -> float:
    """What a control cycle may take, s: `PATIENCE` times what one that tries all usually does, `prompt_s` in any case.

    `before_s` is what its messages and snapshot usually take. Before anything is known there is no limit.
    """
    if not usual.sequence:
        return float("inf")
    return max(prompt_s, PATIENCE * (before_s + need_s(usual, load, top)))


def programs_limit_s(usual: Costs, load: Load, prompt_s: float) -> float:
    """What the programs together may take, s: `PROGRAMS_PATIENCE` times what they usually do, or what is prompt."""
    if not usual.program:
        return float("inf")
    return max(PROMPT_PROGRAMS * prompt_s, PROGRAMS_PATIENCE * usual.program * load.planned)


def rest_s(costs: Costs, load: Load) -> float:
    """What comes after the programs, s: interlock, commands, publishing."""
    return costs.rest * load.present


def need_s(costs: Costs, load: Load, level: int) -> float:
    """What a level needs with all that comes after it, s; never less than a lower one."""
    programs = costs.program if level > UNSOLVED else 0.0
    planned = costs.sequence * (max(level, ALONE) + SHARED) + programs
    return planned * load.planned + rest_s(costs, load)


def fitting(costs: Costs, load: Load, left_s: float, top: int) -> int:
    """The highest level up to `top` that needs no more than `left_s`; the lowest of all if none does."""
    return next((level for level in range(top, UNSOLVED, -1) if need_s(costs, load, level) <= left_s), UNSOLVED)


def without_programs(costs: Costs, load: Load, left_s: float, top: int) -> int:
    """How many sequences, one to `top`, fit into `left_s` on level 0, with time to spare."""
    each_s = costs.sequence * load.planned
    room_s = SPARE * left_s - rest_s(costs, load)
    return next((count for count in range(top, ALONE, -1) if (count + SHARED) * each_s <= room_s), ALONE)


def step(ladder: Ladder, costs: Costs, load: Load, left_s: float, top: int) -> Ladder:
    """The ladder for a control cycle that has `left_s` from here on."""
    fits = fitting(costs, load, left_s, top)
    if fits < ladder.level:
        return Ladder(fits, 0, min(2 * ladder.patience, MOST_CALM_CYCLES), rose=False)
    roomy = min(fitting(costs, load, SPARE * left_s, top), max(ladder.level + 1, 2 * ladder.level))
    if roomy < min(ladder.level + 1, top):
        return ladder._replace(calm=0)
    if ladder.calm + 1 < ladder.patience:
        return ladder._replace(calm=ladder.calm + 1)
    patience = max(ladder.patience // 2, CALM_CYCLES) if ladder.rose else ladder.patience
    return Ladder(roomy, 0, patience, rose=True)


def learned(costs: Costs, load: Load, done: Done, took: Took) -> Costs:
    """The estimates after a control cycle. One that was held up for longer than its whole time counts as that long."""
    now = _measured(costs, load, done, took)
    program = costs.program + FALL * (now.program - costs.program) if done.begun else FADE * costs.program
    return Costs(*map(_towards, costs, now))._replace(program=program)


def accustomed(usual: Costs, load: Load, done: Done, took: Took) -> Costs:
    """What is usual after a control cycle: a step towards the medians, however far off one of them is."""
    together = done._replace(ready=min(done.ready, 1))
    return Costs(*map(_median, usual, _measured(usual, load, together, took)))


def _measured(costs: Costs, load: Load, done: Done, took: Took) -> Costs:
    """What a control cycle took, per vehicle; what it did not do is taken to cost as before."""
    sequence_s, program_s = load.planned * costs.sequence, load.planned * costs.program
    if done.sequences:
        sequence_s = took.sequences / (done.sequences + SHARED)
    if done.ready:
        program_s = took.programs / done.ready
    elif done.begun:  # not to be ready in less than it takes says nothing
        program_s = max(LATE * took.programs, program_s)
    shared_s = took.shared or load.planned * costs.shared
    return Costs(
        sequence=min(sequence_s, STEP_S) / load.planned,
        program=min(program_s, STEP_S) / load.planned,
        shared=min(shared_s, STEP_S) / load.planned,
        rest=min(took.rest, STEP_S) / load.present,
        snapshot=min(took.snapshot, STEP_S) / load.present,
    )


def _median(usual: float, measured: float) -> float:
    if not usual:
        return measured
    return min(measured, usual * SLIP) if measured > usual else max(measured, usual / SLIP)


def _towards(estimate: float, measured: float) -> float:
    if not estimate:
        return measured
    return estimate + (RISE if measured > estimate else FALL) * (measured - estimate)
