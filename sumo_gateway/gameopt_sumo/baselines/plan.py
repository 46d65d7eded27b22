"""A signal plan, and the file it is kept in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import msgspec
from msgspec import Meta

from gameopt_sumo.files import write_whole

Kind = Literal["fixed", "actuated"]
Left = Literal["protected", "permissive", "both"]
Right = Literal["always", "with-straight"]
Within = Literal["straight", "left", "all"]

SHORTEST_GREEN_S = 4.0
"""No stage may be shorter."""


class BaselineError(Exception):
    """A plan, a net or a folder that will not do; one line."""


class PlanError(BaselineError):
    """The plan is at fault; whoever read it from a file puts the file's name before."""


class Stage(NamedTuple):
    """What has green together: movements of an axis, a pair of opposite roads (0 for roads 0 and 1, 1 for 2 and 3)."""

    axis: int
    within: Within

    def __str__(self) -> str:
        return f"{self.within} of roads {2 * self.axis} and {2 * self.axis + 1}"


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Fixed or actuated lights. Times in s.

    `left`: "protected" has a stage of its own, after the straight movements of its axis; "permissive" goes with them,
    through gaps in the opposite stream; "both" goes through gaps first and has its own stage then. `right`: "always"
    has its own arrow at all times and yields where it merges; "with-straight" goes with the straight movements.
    """

    method: Kind
    cycle_s: Annotated[float, Meta(ge=20.0, le=300.0)]
    """The signal cycle, yellow and all red included; of actuated lights the longest one."""
    splits: tuple[Annotated[float, Meta(gt=0.0, le=1.0)], ...]
    """Shares of the cycle's green time, stage by stage; they add up to 1."""
    left: Left = "protected"
    right: Right = "always"
    yellow_s: Annotated[float, Meta(ge=1.0, le=10.0)] = 4.0
    all_red_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    min_green_s: Annotated[float, Meta(ge=SHORTEST_GREEN_S, le=60.0)] = 5.0
    """Actuated: a stage's least green time; its most is its share of the cycle."""
    max_gap_s: Annotated[float, Meta(ge=0.5, le=10.0)] = 3.0
    """Actuated: green ends with the first gap between vehicles that is longer."""
    detector_gap_s: Annotated[float, Meta(ge=0.5, le=5.0)] = 2.0
    """Actuated: how far before the stop line the detectors lie, in time at the speed limit."""

    def stages(self, axes: int) -> list[Stage]:
        """The stages of a junction with this many axes, in their order."""
        parts: tuple[Within, ...] = ("all",) if self.left == "permissive" else ("straight", "left")
        return [Stage(axis, part) for axis in range(axes) for part in parts]

    def greens_s(self, axes: int) -> list[float]:
        """Green times stage by stage, to the simulation step. Raises `PlanError` for splits that do not fit."""
        stages = self.stages(axes)
        if len(self.splits) != len(stages):
            listed = ", ".join(map(str, stages))
            raise PlanError(f"splits has {len(self.splits)} shares, {len(stages)} are needed: {listed}")
        if abs(sum(self.splits) - 1.0) > 0.01:
            raise PlanError(f"splits must add up to 1, these make {sum(self.splits):g}")
        green_s = self.cycle_s - len(stages) * (self.yellow_s + self.all_red_s)
        greens_s = [round(share / sum(self.splits) * green_s, 1) for share in self.splits]
        least_s = self.min_green_s if self.method == "actuated" else SHORTEST_GREEN_S
        for stage, stage_s in zip(stages, greens_s, strict=True):
            if stage_s < least_s:
                raise PlanError(
                    f"a cycle_s of {self.cycle_s:g} leaves {stage_s:g} s of green to {stage}, "
                    f"allowed: {least_s:g} or more"
                )
        return greens_s


def read_plan(file: Path, method: Kind) -> Plan:
    """The plan in a JSON file. Raises `BaselineError` that names the file, the key and what is allowed."""
    try:
        plan = msgspec.json.decode(file.read_bytes(), type=Plan)
    except OSError as error:
        raise BaselineError(f"{file}: cannot read: {error.strerror or error}") from None
    except msgspec.DecodeError as error:
        raise BaselineError(f"{file}: not a plan: {error}") from None
    if plan.method != method:
        raise BaselineError(f"{file}: method is {plan.method!r}, allowed here: {method!r}")
    return plan


def write_plan(plan: Plan, file: Path) -> None:
    """Keep a plan as indented JSON, whole or not at all. Raises `FileError`."""
    write_whole(file, msgspec.json.format(msgspec.json.encode(plan), indent=2) + b"\n")
