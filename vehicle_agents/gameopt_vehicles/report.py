"""The fixed JSON report, and the summary table that ends a run. Null where a run has no such figure."""

from __future__ import annotations

import platform
from importlib import metadata

import msgspec
import numpy as np
from rich.table import Table

from gameopt_vehicles.round_trip import RoundTrip
from gameopt_vehicles.tally import Tally, WholeWay
from gameopt_wire import WIRE_VERSION
from gameopt_wire.intersection import Charter

SCHEMA = "gameopt-report/1"


class VehicleCounts(msgspec.Struct, kw_only=True):
    """Vehicles in the measuring window: due, let onto the road, across, and where the rest are at its end."""

    arrived: int | None = None
    entered: int | None = None
    crossed: int | None = None
    in_zone: int | None = None
    waiting_to_enter: int | None = None


class TimeToGoal(msgspec.Struct, kw_only=True):
    """From the zone's entry to the exit lane, s."""

    mean: float | None = None
    p50: float | None = None
    p95: float | None = None
    max: float | None = None


class TimeLoss(msgspec.Struct, kw_only=True):
    """Against free flow, s."""

    mean: float | None = None
    p95: float | None = None
    max: float | None = None


class ClassFigures(msgspec.Struct, kw_only=True):
    """Means of one vehicle class."""

    count: int
    time_to_goal_s: float | None = None
    fuel_g: float | None = None
    co2_g: float | None = None


class Safety(msgspec.Struct, kw_only=True):
    """Collisions by the simulator's count and by geometry, least post-encroachment time, hard braking."""

    collisions_sumo: int | None = None
    collisions_geometric: int | None = None
    min_pet_s: float | None = None
    hard_brakes: int | None = None
    teleports: int | None = None


class Measurements(msgspec.Struct, kw_only=True):
    """What the road measured; read from any object or mapping with these names."""

    vehicles: VehicleCounts = msgspec.field(default_factory=VehicleCounts)
    throughput_veh_min: float | None = None
    time_to_goal_s: TimeToGoal = msgspec.field(default_factory=TimeToGoal)
    time_loss_s: TimeLoss = msgspec.field(default_factory=TimeLoss)
    fuel_g: float | None = None
    co2_g: float | None = None
    fuel_total_g: float | None = None
    co2_total_g: float | None = None
    by_class: dict[str, ClassFigures] = msgspec.field(default_factory=dict)
    safety: Safety = msgspec.field(default_factory=Safety)


class ControlCycle(msgspec.Struct, kw_only=True):
    """The manager's control cycles in the measuring window, by its own reports.

    For want of time, `dropped` candidates were not tried, and `unsolved` control cycles went without programs.
    """

    count: int
    missed: int
    p50_ms: float | None
    p99_ms: float | None
    max_ms: float | None
    dropped: int = 0
    unsolved: int = 0


class Programs(msgspec.Struct, kw_only=True):
    """Quadratic programs solved, without a checked solution, and too late."""

    solved: int
    failed: int
    late: int


class Messages(msgspec.Struct, kw_only=True):
    """States and bids sent, commands received, either lost by injected faults, and what was no message."""

    sent: int
    received: int
    lost: int
    rejected: int


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """How the run was set up."""

    scenario: str
    seed: int
    duration_s: float
    warmup_s: float
    flow_veh_h: float | None = None
    ratio: float | None = None


class Report(msgspec.Struct, kw_only=True):
    """The report, field for field."""

    schema: str
    versions: dict[str, str]
    method: str
    scenario: str
    intersection: str
    profile: str
    geometry: str
    turn_speed: bool
    candidates: int
    workers: int
    clock: str
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
    fuel_total_g: float | None
    co2_total_g: float | None
    by_class: dict[str, ClassFigures]
    safety: Safety
    control_cycle: ControlCycle
    qp: Programs
    fallbacks: int
    messages: Messages
    late_steps: int
    round_trip: RoundTrip
    whole_way: WholeWay

    def collided(self) -> bool:
        """Whether any count saw a collision, or a vehicle was teleported out of one."""
        safety = self.safety
        return any((safety.collisions_sumo, safety.collisions_geometric, safety.teleports))

    def to_json(self) -> bytes:
        """The report as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2) + b"\n"


def assemble(run: Run, charter: Charter, measured: object, tally: Tally, lost: int) -> Report:
    """Put the road's measurements, the fleet's counters and the manager's charter together."""
    road = msgspec.convert(measured, Measurements, from_attributes=True)
    elapsed = np.array(tally.elapsed_ms) if tally.elapsed_ms else None
    p50, p99, worst = (None, None, None) if elapsed is None else np.percentile(elapsed, [50, 99, 100]).tolist()
    totals = tally.totals
    return Report(
        schema=SCHEMA,
        versions=_versions(),
        method="coop" if charter.profile == "default" else f"coop-{charter.profile}",
        intersection=charter.map.intersection,
        profile=charter.profile,
        geometry=charter.geometry,
        turn_speed=charter.turn_speed,
        candidates=charter.candidates,
        workers=charter.workers,
        clock=charter.clock,
        **msgspec.structs.asdict(run),
        **msgspec.structs.asdict(road),
        control_cycle=ControlCycle(
            count=len(tally.elapsed_ms),
            missed=totals["missed_total"],
            dropped=totals["dropped_total"],
            unsolved=totals["unsolved_total"],
            p50_ms=p50,
            p99_ms=p99,
            max_ms=worst,
        ),
        qp=Programs(solved=totals["qp_solved_total"], failed=totals["qp_failed_total"], late=totals["qp_late_total"]),
        fallbacks=tally.fallbacks,
        messages=Messages(sent=tally.sent, received=tally.received, lost=lost, rejected=tally.rejected),
        late_steps=tally.late_steps,
        round_trip=tally.round_trips.summary(),
        whole_way=tally.whole_way(),
    )


def _versions() -> dict[str, str]:
    versions = {"wire": str(WIRE_VERSION), "python": platform.python_version()}
    for name, distribution in (("gameopt", "gameopt"), ("zenoh", "eclipse-zenoh"), ("sumo", "libsumo")):
        try:
            versions[name] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    return versions


def summary(report: Report) -> Table:
    """The report as a table to read."""
    table = Table(title=f"{report.scenario}: {report.method} at {report.intersection}", show_header=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    vehicles, goal, loss, safety = report.vehicles, report.time_to_goal_s, report.time_loss_s, report.safety
    cycle, qp, messages = report.control_cycle, report.qp, report.messages
    trip, whole = report.round_trip, report.whole_way.whole
    rows = {
        "simulated, of which warm-up": f"{report.duration_s:g} s, {report.warmup_s:g} s ({report.clock})",
        "vehicles arrived / crossed": f"{_n(vehicles.arrived)} / {_n(vehicles.crossed)}",
        "in the zone / waiting to enter": f"{_n(vehicles.in_zone)} / {_n(vehicles.waiting_to_enter)}",
        "throughput": f"{_n(report.throughput_veh_min)} veh/min",
        "time to goal, mean / p95 / max": f"{_n(goal.mean)} / {_n(goal.p95)} / {_n(goal.max)} s",
        "time loss, mean / p95 / max": f"{_n(loss.mean)} / {_n(loss.p95)} / {_n(loss.max)} s",
        "fuel / CO2 per vehicle": f"{_n(report.fuel_g)} / {_n(report.co2_g)} g",
        "collisions, SUMO / geometric": f"{_n(safety.collisions_sumo)} / {_n(safety.collisions_geometric)}",
        "least PET / hard brakes / teleports": (
            f"{_n(safety.min_pet_s)} s / {_n(safety.hard_brakes)} / {_n(safety.teleports)}"
        ),
        "control cycles / missed / late steps": f"{cycle.count} / {cycle.missed} / {report.late_steps}",
        "control cycle, p50 / p99 / max": f"{_n(cycle.p50_ms)} / {_n(cycle.p99_ms)} / {_n(cycle.max_ms)} ms",
        "candidates dropped / cycles without programs": f"{cycle.dropped} / {cycle.unsolved}",
        "the whole way, p50 / p99 / max": (
            f"{_n(whole.p50_ms)} / {_n(whole.p99_ms)} / {_n(whole.max_ms)} ms" if whole else _n(None)
        ),
        "round trip, p50 / p99 / max": f"{_n(trip.p50_ms)} / {_n(trip.p99_ms)} / {_n(trip.max_ms)} ms",
        "states unanswered / commands lost": f"{trip.unanswered} / {report.whole_way.commands_lost}",
        "QPs solved / failed / late": f"{qp.solved} / {qp.failed} / {qp.late}",
        "fallbacks": str(report.fallbacks),
        "messages sent / received / lost / rejected": (
            f"{messages.sent} / {messages.received} / {messages.lost} / {messages.rejected}"
        ),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _n(value: float | None) -> str:
    """A figure to read; a dash for one that is lacking."""
    if value is None:
        return "-"
    return f"{value:.1f}" if isinstance(value, float) else str(value)
