"""The report of a baseline: field for field that of our own method, null where SUMO's control has no such figure.

`docs/report.md` says what the fields mean; a test holds the two formats together.
"""

from __future__ import annotations

import platform
from importlib import metadata

import msgspec

from gameopt_sumo.baselines.watch import Watched
from gameopt_sumo.figures import COLLISIONS, ClassFigures, Safety, TimeLoss, TimeToGoal, VehicleCounts
from gameopt_wire import WIRE_VERSION

SCHEMA = "gameopt-report/1"


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The fixed report."""

    schema: str
    versions: dict[str, str]
    method: str
    scenario: str
    intersection: str
    profile: None = None
    geometry: None = None
    turn_speed: bool = True
    """SUMO's drivers respect it."""
    candidates: None = None
    workers: None = None
    clock: None = None
    seed: int
    flow_veh_h: float | None
    ratio: float | None
    duration_s: float
    warmup_s: float
    vehicles: VehicleCounts
    throughput_veh_min: float | None
    time_to_goal_s: TimeToGoal
    time_loss_s: TimeLoss
    fuel_g: float | None
    co2_g: float | None
    fuel_total_g: float
    co2_total_g: float
    by_class: dict[str, ClassFigures]
    safety: Safety
    control_cycle: None = None
    qp: None = None
    fallbacks: None = None
    messages: None = None
    late_steps: None = None
    round_trip: None = None
    whole_way: None = None

    def collided(self) -> bool:
        """Whether any count saw a collision, or a vehicle was teleported out of one."""
        return any(getattr(self.safety, name) for name in COLLISIONS)

    def to_json(self) -> bytes:
        """The report as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


def assemble(method: str, seen: Watched) -> Report:
    """The report of a run under `method`."""
    return Report(
        schema=SCHEMA,
        versions=_versions(),
        method=method,
        scenario=seen.run.config.stem,
        intersection=seen.intersection,
        seed=seen.run.seed,
        flow_veh_h=seen.flow_veh_h,
        ratio=seen.ratio,
        duration_s=seen.duration_s,
        warmup_s=seen.run.warmup_s,
        **{name: getattr(seen.measured, name) for name in seen.measured.__struct_fields__},
    )


def _versions() -> dict[str, str]:
    """Of what has a part in a baseline; Zenoh has none."""
    installed = {name: metadata.version(name) for name in ("gameopt", "libsumo")}
    return {
        "wire": str(WIRE_VERSION),
        "python": platform.python_version(),
        "gameopt": installed["gameopt"],
        "sumo": installed["libsumo"],
    }
