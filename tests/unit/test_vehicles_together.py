"""Several fleets on one road: the gate between their steps, and what the command line says of several junctions."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from click.testing import CliRunner

from gameopt_vehicles.cli import command
from gameopt_vehicles.together import Together


async def steps_of(counts: dict[str, int]) -> list[str]:
    """Who made which step, in their order, where each makes so many."""
    together, made = Together(len(counts)), []

    async def walk(name: str, count: int) -> None:
        for step in range(count):
            await together.all_here()
            made.append(f"{name}{step}")
        together.leave()

    await asyncio.wait_for(asyncio.gather(*(walk(name, count) for name, count in counts.items())), 5.0)
    return made


def test_nobody_begins_a_step_before_all_have_ended_the_last_one() -> None:
    assert asyncio.run(steps_of({"a": 3, "b": 3})) == ["b0", "a0", "a1", "b1", "b2", "a2"]


def test_who_leaves_is_not_waited_for() -> None:
    made = asyncio.run(steps_of({"a": 1, "b": 3, "c": 2}))
    assert [name for name in made if name[0] == "b"] == ["b0", "b1", "b2"]
    assert made[-1] == "b2"


def test_one_alone_waits_for_nobody() -> None:
    assert asyncio.run(steps_of({"a": 2})) == ["a0", "a1"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--sumo", "FILE", "--junction", "a", "--junction", "a"], "name each once"),
        (["--synthetic", "3", "--junction", "a", "--junction", "b"], "several --junction need --sumo"),
    ],
)
def test_junctions_that_cannot_be_are_refused_in_one_line(tmp_path: Path, given: list[str], said: str) -> None:
    (tmp_path / "a.sumocfg").touch()
    words = [str(tmp_path / "a.sumocfg") if word == "FILE" else word for word in given]
    outcome = CliRunner().invoke(command, words)
    assert outcome.exit_code == 2
    assert said in outcome.output
