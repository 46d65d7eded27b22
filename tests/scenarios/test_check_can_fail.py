"""The closed loop does not collide, and the check would say so if it did; the programs are no decoration."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest
from closed_loop import in_a_process

from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.slow

BUSY_S = 36.0
Runs = dict[str, Future[dict[str, Any]]]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    """All runs of this module, two at a time: the same busy scenario, whole and with one thing broken."""
    busy = write_four_arm(FourArm(flow_veh_h=10_000.0, seed=5, duration_s=60.0), tmp_path_factory.mktemp("busy"))
    usual = write_four_arm(FourArm(flow_veh_h=6_000.0, seed=101, duration_s=90.0), tmp_path_factory.mktemp("usual"))
    with ThreadPoolExecutor(2) as pool:
        yield (
            {
                broken: pool.submit(in_a_process, sumocfg=str(busy), duration_s=BUSY_S, broken=broken)
                for broken in ("", "margin", "rear end", "conflict area")
            }
            | {
                inflated: pool.submit(in_a_process, sumocfg=str(busy), duration_s=BUSY_S, inflate_m=float(inflated))
                for inflated in ("0.3", "1.1")
            }
            | {"usual": pool.submit(in_a_process, sumocfg=str(usual), duration_s=65.0, qp_share=True)}
        )


def collisions(found: dict[str, Any]) -> int:
    count = found["safety"]["collisions_geometric"]
    assert isinstance(count, int)
    assert count == len(found["overlapping"])
    return count


def test_nothing_collides_with_nothing_broken(runs: Runs) -> None:
    found = runs[""].result()
    assert found["vehicles"]["entered"] > 50
    assert found["vehicles"]["crossed"] > 20
    assert found["safety"]["collisions_sumo"] == collisions(found) == found["safety"]["teleports"] == 0
    assert found["fallbacks"] == 0


@pytest.mark.parametrize("broken", ["margin", "rear end", "conflict area"])
def test_the_check_fails_once_it_should(runs: Runs, broken: str) -> None:
    found = runs[broken].result()
    assert collisions(found) > 0
    assert found["vehicles"]["entered"] > 50


def test_bodies_a_little_larger_do_not_touch_either(runs: Runs) -> None:
    assert collisions(runs["0.3"].result()) == 0
    assert collisions(runs["1.1"].result()) > 0


def test_the_programs_are_no_decoration(runs: Runs) -> None:
    """At 6,000 veh/h at least 5 % of the uncleared commands would differ on the programs' upper bounds."""
    found = runs["usual"].result()
    assert found["safety"]["collisions_sumo"] == collisions(found) == 0
    assert found["solved"] > 400  # mostly one a control cycle: what cannot win is not solved
    assert found["uncleared_commands"] > 1000
    assert found["changed_commands"] / found["uncleared_commands"] >= 0.05
