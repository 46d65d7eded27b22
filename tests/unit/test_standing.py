"""The stop sign: who stands at its line, in which order, and who may ask; then a whole junction run by it."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import numpy as np
import pytest
from builders import ACROSS, GROUND, OTHER, snapshot
from watched import ROADS, STOP_SIGN

from gameopt_im.core import standing
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of

RIGHT = 0
"""A movement that meets nobody."""


@pytest.mark.parametrize(
    ("s", "v", "age", "there"),
    [
        (1.0, 0.0, 0.0, True),
        (0.994, 0.0, 0.0, True),  # a ballistic step ends millimetres past where rule 1 aims
        (1.3, 0.05, 0.0, True),
        (1.0, 0.5, 0.0, False),
        (9.0, 0.0, 0.0, False),  # behind somebody else
        (1.0, 0.0, 0.1, False),  # predicted
    ],
)
def test_who_stands_where_it_has_to_wait_is_at_its_line(s: float, v: float, age: float, there: bool) -> None:
    assert standing.at_line(snapshot(s=[s], v=[v], age=[age]), GROUND).tolist() == [there]


def queued(previous: tuple[str, ...], uncleared: list[bool], at_line: list[bool]) -> tuple[str, ...]:
    cars = snapshot(s=[1.0] * len(uncleared))
    return standing.queue(previous, cars, np.array(uncleared), np.array(at_line))


def test_the_first_to_stand_goes_first_and_zone_entry_breaks_ties() -> None:
    assert queued((), [True] * 3, [False, True, True]) == ("b", "c")
    assert queued(("c",), [True] * 3, [True, True, True]) == ("c", "a", "b")


def test_who_has_stood_keeps_its_turn_until_it_is_cleared() -> None:
    assert queued(("b", "a"), [True] * 2, [True, False]) == ("b", "a")
    assert queued(("b", "a"), [True, False], [True, True]) == ("a",)


def test_nobody_asks_whom_somebody_before_it_is_in_the_way_of() -> None:
    cars = snapshot(s=[1.0] * 4, movement=[ACROSS, OTHER, OTHER, RIGHT])
    waiting = np.array([1, 0, 2, 3])
    assert standing.next_to_go(waiting, cars, GROUND).tolist() == [1, 3]  # 2 does not pass 0, which waits for 1
    assert standing.next_to_go(waiting[1:], cars, GROUND).tolist() == [0, 3]
    assert standing.next_to_go(waiting[:0], cars, GROUND).tolist() == []


async def driven(cycles: int) -> tuple[dict[str, int], dict[str, int]]:
    """The control cycles in which each vehicle first stood at its line, and was offered its clearance."""
    options = ServeOptions(map=ROADS, parameters=STOP_SIGN, clock="lockstep", workers=0, geometry="box")
    traffic = Rehearsal(ROADS, 12)
    stood: dict[str, int] = {}
    offered: dict[str, int] = {}
    async with solver_of(options) as pool:
        manager = Manager(options, 1, pool)
        for cycle in range(1, cycles):
            for extra in traffic._extras.values():
                if extra.v < 0.1 and -1.6 < extra.x < -0.9:
                    stood.setdefault(extra.name, cycle)
            outcome = await manager.control_cycle(cycle, cycle / 10, traffic.messages(cycle / 10))
            for command in outcome.commands:
                if command.clearance is not None:
                    offered.setdefault(command.vehicle, cycle)
            traffic.obey(outcome.commands)
    return stood, offered


def test_a_whole_junction_halts_goes_in_turn_and_nobody_starves() -> None:
    stood, offered = asyncio.run(driven(600))
    assert len(offered) > 10
    assert all(stood[vehicle] <= cycle for vehicle, cycle in offered.items())
    turns = sorted(offered, key=lambda vehicle: offered[vehicle])
    # From one road or the other, all of them conflict: they go in the order in which they came to a stand.
    assert all(stood[first] <= stood[second] for first, second in pairwise(turns))
    assert max(offered[vehicle] - stood[vehicle] for vehicle in offered) < 100
