"""What is counted while the fleet drives; the report and the progress line read it."""

from __future__ import annotations

from gameopt_wire.messages import CycleReport

_TOTALS = ("qp_solved_total", "qp_failed_total", "qp_late_total", "missed_total", "dropped_total", "unsolved_total")


class Tally:
    """Counters of one measuring window; `restart` begins a new one (the end of the warm-up)."""

    def __init__(self) -> None:
        self._term = -1
        self._last: dict[str, int] = {}
        self.restart()

    def restart(self) -> None:
        """Forget what was counted, but not where the manager's running totals stand."""
        self.sent = self.received = self.rejected = 0
        self.fallbacks = 0
        self.late_steps = 0
        self.elapsed_ms: list[float] = []
        self.totals = dict.fromkeys(_TOTALS, 0)

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
