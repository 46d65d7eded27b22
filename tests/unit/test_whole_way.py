"""The whole way: from the last state waited for to the last command, its stages without a gap."""

from __future__ import annotations

import pytest
from test_vehicles_report import cycle_report

from gameopt_im import whole_way
from gameopt_im.manager import Outcome


def test_the_stages_add_up_to_the_whole_way() -> None:
    closed_s = 1000.0
    began_s = closed_s + 0.001  # woken, read
    decided_s = began_s + 0.004
    report = cycle_report(1, 0, 0, elapsed_ms=4.0, stages_ms={"ingest": 1.5, "auction": 2.5})
    outcome = whole_way.measured(Outcome([], report, [], decided_s, decided_s + 0.002), closed_s, 0.0003)
    complete = outcome.report
    assert complete.stages_ms["ingest"] == pytest.approx(2.5)
    assert complete.stages_ms["publish"] == pytest.approx(2.0)
    assert complete.whole_ms == pytest.approx(sum(complete.stages_ms.values()))
    assert complete.whole_ms == pytest.approx(7.0)
    assert complete.late_ms == pytest.approx(0.3)
    assert complete.elapsed_ms == 4.0  # the decision alone, as before
    assert "publish" not in report.stages_ms


def test_lock_step_is_never_late() -> None:
    report = cycle_report(1, 0, 0, stages_ms={"ingest": 1.0})
    assert whole_way.measured(Outcome([], report, [], 0.0), 0.0, None).report.late_ms is None
