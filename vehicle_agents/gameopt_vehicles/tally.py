"""What is counted while the fleet drives; the report and the progress line read it."""

from __future__ import annotations

from collections import Counter

import msgspec

from gameopt_vehicles.round_trip import RoundTrips
from gameopt_vehicles.timings import Spread, Timings
from gameopt_wire.messages import Command, CycleReport

_TOTALS = ("qp_solved_total", "qp_failed_total", "qp_late_total", "missed_total", "dropped_total", "unsolved_total")


class WholeWay(msgspec.Struct, kw_only=True):
    """The manager's control cycles by its own reports: the whole way, how late it began, and each stage.

    `vehicles` is how many it had to do with, on average; `commands_lost` were sent, by the reports, and did not come.
    """

    vehicles: float | None
    commands_lost: int
    whole: Spread | None = None
    late: Spread | None = None
    stages: dict[str, Spread] = msgspec.field(default_factory=dict)


class Tally:
    """Counters of one measuring window; `restart` begins a new one (the end of the warm-up)."""

    def __init__(self) -> None:
        self._term = -1
        self._last: dict[str, int] = {}
        self.round_trips = RoundTrips()
        self._heard: Counter[tuple[int, int]] = Counter()
        self._announced: dict[tuple[int, int], int] = {}
        self.restart()

    def restart(self) -> None:
        """Forget what was counted, but not where the manager's running totals stand."""
        self.sent = self.received = self.rejected = 0
        self.fallbacks = 0
        self.late_steps = 0
        self.elapsed_ms: list[float] = []
        self.totals = dict.fromkeys(_TOTALS, 0)
        self.round_trips.restart()
        self._vehicles = self._commands_lost = 0
        self._whole, self._late = Timings(), Timings()
        self._stages: dict[str, Timings] = {}

    def heard(self, command: Command, at_s: float) -> None:
        """Count a command that came at `at_s` on the monotonic clock."""
        self.received += 1
        self._heard[command.term, command.cycle] += 1
        self.round_trips.answered(command.vehicle, command.cycle, at_s)

    def add(self, report: CycleReport) -> None:
        """Count one control cycle; totals that began before the first report seen are not ours."""
        now = {name: int(getattr(report, name)) for name in _TOTALS}
        if report.term != self._term:
            self._last = now if self._term < 0 else dict.fromkeys(_TOTALS, 0)
            self._term = report.term
        for name, value in now.items():
            self.totals[name] += max(0, value - self._last[name])
        self._last = now
        self.elapsed_ms.append(report.elapsed_ms)
        self._vehicles += report.vehicles
        if report.whole_ms is not None:
            self._whole.observe(1e-3 * report.whole_ms)
        if report.late_ms is not None:
            self._late.observe(1e-3 * report.late_ms)
        for stage, elapsed_ms in report.stages_ms.items():
            self._stages.setdefault(stage, Timings()).observe(1e-3 * elapsed_ms)
        self._settle(report)

    def whole_way(self) -> WholeWay:
        """The stages of the control cycles so far."""
        spreads = {stage: timings.spread() for stage, timings in self._stages.items()}
        return WholeWay(
            vehicles=round(self._vehicles / len(self.elapsed_ms), 1) if self.elapsed_ms else None,
            commands_lost=self._commands_lost,
            whole=self._whole.spread(),
            late=self._late.spread(),
            stages={stage: spread for stage, spread in spreads.items() if spread is not None},
        )

    def _settle(self, report: CycleReport) -> None:
        """A report says how many commands went before it; they are waited for until the next report."""
        now = report.term, report.cycle
        for before in [each for each in self._announced if each < now]:
            self._commands_lost += max(0, self._announced.pop(before) - self._heard[before])
        for before in [each for each in self._heard if each < now]:
            del self._heard[before]
        self._announced[now] = report.commands
