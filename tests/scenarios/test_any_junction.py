"""Junctions of other shapes in the closed loop: nobody collides, and nobody is left standing."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest
from closed_loop import in_a_process
from sites import site

pytestmark = pytest.mark.slow

FLOWS_VEH_H = {
    "t-junction": 2400.0, "five-arm": 2400.0, "single-lane": 1600.0, "shared-lane": 3000.0, "fan": 2000.0,
    "cross": 3000.0, "corridor": 1400.0, "square": 1400.0,
}  # fmt: skip
DURATION_S = 90.0
Runs = dict[str, Future[dict[str, Any]]]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    """Every shape once, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        started = {}
        for name, flow in FLOWS_VEH_H.items():
            folder = tmp_path_factory.mktemp(name)
            place = site(name, folder)
            config = place.scenario(folder, flow, 7, DURATION_S)
            started[name] = pool.submit(
                in_a_process, sumocfg=str(config), junction=place.junction, duration_s=DURATION_S
            )
        yield started


@pytest.mark.parametrize("name", FLOWS_VEH_H)
def test_nobody_collides_and_everybody_gets_across(runs: Runs, name: str) -> None:
    found = runs[name].result()
    vehicles, safety = found["vehicles"], found["safety"]
    assert safety["collisions_sumo"] == safety["collisions_geometric"] == safety["teleports"] == 0
    assert vehicles["entered"] > 20
    assert vehicles["crossed"] > 0.5 * vehicles["entered"]
    assert found["rejected"] == {}
    assert safety["hard_brakes"] <= 0.1 * vehicles["entered"]
