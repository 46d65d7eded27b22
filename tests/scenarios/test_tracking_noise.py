"""Vehicles whose speed is never quite what they aim at, on a busy junction."""

from __future__ import annotations

from pathlib import Path

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow


def test_nobody_collides_however_badly_speeds_are_tracked(tmp_path: Path) -> None:
    """Sigma 0.2 m/s in every step, where tight platoons make the most of it."""
    busy = write_four_arm(FourArm(flow_veh_h=10_000.0, seed=102, duration_s=110.0), tmp_path)
    found = in_a_process(sumocfg=str(busy), duration_s=110.0, tracking_noise_mps=0.2)
    safety = found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert found["vehicles"]["crossed"] > 100
