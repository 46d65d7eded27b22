"""The closed loop does not collide, and the check would say so if it did; the programs are no decoration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow

BUSY_S = 36.0


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scenario that is run whole, and with one thing broken."""
    return write_four_arm(FourArm(flow_veh_h=10_000.0, seed=5, duration_s=60.0), tmp_path_factory.mktemp("busy"))


def collisions(found: dict[str, Any]) -> int:
    count = found["safety"]["collisions_geometric"]
    assert isinstance(count, int)
    assert count == len(found["overlapping"])
    return count


def test_nothing_collides_with_nothing_broken(busy: Path) -> None:
    found = in_a_process(sumocfg=busy, duration_s=BUSY_S)
    assert found["vehicles"]["entered"] > 50
    assert found["vehicles"]["crossed"] > 20
    assert found["safety"]["collisions_sumo"] == collisions(found) == found["safety"]["teleports"] == 0
    assert found["fallbacks"] == 0


@pytest.mark.parametrize("broken", ["margin", "rear end", "conflict area"])
def test_the_check_fails_once_it_should(busy: Path, broken: str) -> None:
    found = in_a_process(sumocfg=busy, duration_s=BUSY_S, broken=broken)
    assert collisions(found) > 0
    assert found["vehicles"]["entered"] > 50


def test_bodies_a_little_larger_do_not_touch_either(busy: Path) -> None:
    assert collisions(in_a_process(sumocfg=busy, duration_s=BUSY_S, inflate_m=0.3)) == 0
    assert collisions(in_a_process(sumocfg=busy, duration_s=BUSY_S, inflate_m=1.1)) > 0


def test_the_programs_are_no_decoration(tmp_path: Path) -> None:
    """At 6,000 veh/h at least 5 % of the uncleared commands would differ on the programs' upper bounds."""
    usual = write_four_arm(FourArm(flow_veh_h=6_000.0, seed=101, duration_s=90.0), tmp_path)
    found = in_a_process(sumocfg=usual, duration_s=65.0, qp_share=True)
    assert found["safety"]["collisions_sumo"] == collisions(found) == 0
    assert found["solved"] > 400  # mostly one a control cycle: what cannot win is not solved
    assert found["uncleared_commands"] > 1000
    assert found["changed_commands"] / found["uncleared_commands"] >= 0.05
