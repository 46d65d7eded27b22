"""SUMO with every third message lost and the others late and out of order: nobody is harmed, and traffic flows."""

from __future__ import annotations

from pathlib import Path

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow


def test_traffic_flows_without_a_collision_over_a_bad_link(tmp_path: Path) -> None:
    busy = write_four_arm(FourArm(flow_veh_h=5_000.0, seed=104, duration_s=90.0), tmp_path)
    found = in_a_process(sumocfg=str(busy), duration_s=70.0, loss=0.33, delay_s=0.1, jitter_s=0.1)
    assert found["lost"] > 1_000
    assert found["rejected"]["stale"] > 100  # overtaken by newer ones
    assert found["safety"]["collisions_sumo"] == found["safety"]["collisions_geometric"] == 0
    assert found["safety"]["teleports"] == 0
    assert found["vehicles"]["crossed"] > 30
