"""The stop sign on a running SUMO: everybody halts at its line, nobody collides, and the queues empty."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow

STOP_SIGN = (resources.files("gameopt_sumo") / "compare" / "methods" / "stop-sign.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("noise_mps", [0.0, 0.2])
def test_everybody_halts_and_gets_through(tmp_path: Path, noise_mps: float) -> None:
    config = write_four_arm(FourArm(flow_veh_h=1_200.0, seed=7, duration_s=60.0), tmp_path)
    found = in_a_process(
        sumocfg=str(config), duration_s=110.0, geometry="box", configuration=STOP_SIGN, tracking_noise_mps=noise_mps
    )
    vehicles, safety = found["vehicles"], found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert found["ran_through"] == []
    assert found["halted"] == vehicles["crossed"] == vehicles["arrived"] > 12
