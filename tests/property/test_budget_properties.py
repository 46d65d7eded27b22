"""What a control cycle leaves out for want of time, on costs and times that are numbers."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gameopt_im.core.budget import (
    ALONE,
    MOST_CALM_CYCLES,
    SHARED,
    SLIP,
    SPARE,
    UNSOLVED,
    Costs,
    Done,
    Ladder,
    Load,
    Took,
    accustomed,
    fitting,
    learned,
    limit_s,
    need_s,
    rest_s,
    slowness,
    step,
    without_programs,
)
from gameopt_wire.messages import STEP_S

TOP = 9
BUDGET_S, DEADLINE_S = 0.06, 0.04
seconds = st.floats(0.0, 0.2)
each = st.floats(0.0, 1e-3)
costs_ = st.builds(Costs, *[each] * 5)
loads = st.builds(Load, st.integers(0, 1000), st.integers(0, 500))


class Machine:
    """A machine on which a sequence, a program and the rest take a fixed time, and the ladder's account of it.

    A program ends at its deadline, ready or not.
    """

    def __init__(self, sequence_s: float, program_s: float, rest_s: float = 0.002) -> None:
        self.sequence_s, self.program_s, self.rest_s, self.load = sequence_s, program_s, rest_s, Load(260, 110)
        self.costs, self.ladder = Costs(), Ladder(TOP)

    def cycle(self) -> float:
        """One control cycle; how long it took."""
        self.ladder = step(self.ladder, self.costs, self.load, BUDGET_S, TOP)
        level = self.ladder.level
        sequences, begun = max(level, ALONE), int(level > UNSOLVED)
        auction_s = (sequences + SHARED) * self.sequence_s
        until_s = max(0.0, min(DEADLINE_S, BUDGET_S - auction_s - rest_s(self.costs, self.load)))
        ready = int(begun and self.program_s <= until_s)
        took = Took(auction_s, begun * min(self.program_s, until_s), self.rest_s)
        self.costs = learned(self.costs, self.load, Done(sequences, begun, ready), took)
        return sum(took)

    def run(self, cycles: int) -> list[tuple[int, float]]:
        """(level, time) of each control cycle."""
        times = (self.cycle() for _ in range(cycles))
        return [(self.ladder.level, time) for time in times]


@given(costs=costs_, load=loads, left_s=seconds, more_s=seconds)
def test_a_level_contains_those_below_it_and_more_time_never_means_less(
    costs: Costs, load: Load, left_s: float, more_s: float
) -> None:
    needs = [need_s(costs, load, level) for level in range(TOP + 1)]
    assert needs == sorted(needs)
    fits = fitting(costs, load, left_s, TOP)
    assert fits == UNSOLVED or needs[fits] <= left_s
    assert fits == TOP or needs[fits + 1] > left_s
    assert fitting(costs, load, left_s + more_s, TOP) >= fits


@given(costs=costs_, load=loads, left_s=st.floats(-1.0, 0.2))
def test_without_programs_as_many_sequences_are_made_as_fit(costs: Costs, load: Load, left_s: float) -> None:
    sequences = without_programs(costs, load, left_s, TOP)
    all_s = [need_s(costs, load, level) for level in range(TOP + 2)]
    programs_s = need_s(costs, load, ALONE) - need_s(costs, load, UNSOLVED)
    assert ALONE <= sequences <= TOP
    assert sequences == ALONE or all_s[sequences] - programs_s <= SPARE * left_s + 1e-12
    assert sequences == TOP or all_s[sequences + 1] - programs_s > SPARE * left_s - 1e-12


@given(costs=costs_, load=loads, more=st.integers(0, 500), left_s=seconds)
def test_more_vehicles_never_mean_more_candidates(costs: Costs, load: Load, more: int, left_s: float) -> None:
    fuller = Load(load.vehicles + more, load.uncleared + more)
    assert fitting(costs, fuller, left_s, TOP) <= fitting(costs, load, left_s, TOP)


@given(
    took=st.lists(st.tuples(loads, st.builds(Took, *[st.floats(0.0, 10.0)] * 5), st.integers(0, 1)), max_size=50),
    left_s=st.floats(-1.0, 0.1),
)
def test_whatever_was_measured_one_sequence_remains_and_estimates_stay_within_a_control_cycle(
    took: list[tuple[Load, Took, int]], left_s: float
) -> None:
    costs, ladder = Costs(), Ladder(TOP)
    for load, times, ready in took:
        ladder = step(ladder, costs, load, left_s, TOP)
        assert UNSOLVED <= ladder.level <= TOP
        costs = learned(costs, load, Done(max(ladder.level, ALONE), 1, ready), times)
        assert all(0.0 <= each <= STEP_S for each in costs)


@pytest.mark.parametrize(
    ("sequence_s", "program_s", "level"),
    [
        (0.0002, 0.010, 9),
        (0.0050, 0.020, 4),  # 0.002 + (4 + 3) * 0.005 + 0.020 = 0.057
        (0.0085, 0.020, 1),
        (0.0050, 0.070, 0),  # not even one program
        (0.2000, 0.200, 0),  # not even the incumbent: nothing more can be left out
    ],
)
def test_under_a_steady_load_the_level_settles_where_it_fits(sequence_s: float, program_s: float, level: int) -> None:
    machine = Machine(sequence_s, program_s)
    seen = machine.run(2000)
    late = seen[1000:]
    assert {found for found, _ in late} <= {level, level - 1, level + 1}
    assert sum(found == level for found, _ in late) >= 0.9 * len(late)
    if level > UNSOLVED:
        assert sum(time > 1.01 * BUDGET_S for _, time in seen) <= 5


def test_a_load_on_the_edge_does_not_make_it_flap() -> None:
    """The costs go up and down by a third from one control cycle to the next, around what just fits."""
    machine = Machine(0.0060, 0.010)
    levels = []
    for k in range(6000):
        machine.sequence_s = 0.0048 if k % 7 else 0.0064
        machine.cycle()
        levels.append(machine.ladder.level)
    changes = sum(one != other for one, other in pairwise(levels[1000:]))
    assert changes <= 2 * 5000 / MOST_CALM_CYCLES + 2


def test_it_recovers_from_a_burst_and_from_a_long_overload() -> None:
    machine = Machine(0.0002, 0.010)
    machine.run(100)
    machine.sequence_s, machine.program_s = 0.05, 0.1
    machine.run(20)
    assert machine.ladder.level == UNSOLVED
    machine.sequence_s, machine.program_s = 0.0002, 0.010
    burst = machine.run(100)
    assert burst[-1][0] == TOP
    machine.sequence_s, machine.program_s = 0.05, 0.1
    machine.run(3000)
    machine.sequence_s, machine.program_s = 0.0002, 0.010
    assert machine.run(4 * MOST_CALM_CYCLES)[-1][0] == TOP


def test_a_program_that_is_never_ready_in_time_makes_room_for_itself_then_is_left_out() -> None:
    costs, load, ladder = Costs(), Load(100, 50), Ladder(TOP)
    levels = []
    for _ in range(20):
        ladder = step(ladder, costs, load, BUDGET_S, TOP)
        levels.append(ladder.level)
        sequences = max(ladder.level, ALONE)
        # What the sequences leave goes to the programs, none of which is ready.
        took = Took(sequences * 0.003, 0.055 - sequences * 0.003, 0.001)
        costs = learned(costs, load, Done(sequences, int(ladder.level > UNSOLVED), 0), took)
    assert levels[0] == TOP
    assert UNSOLVED in levels


@given(usual_s=st.floats(1e-4, 5e-3), slow=st.floats(1.0, 20.0), every=st.integers(3, 20))
def test_what_a_snapshot_usually_takes_is_known_however_slow_some_are(usual_s: float, slow: float, every: int) -> None:
    usual, load = Costs(), Load(260, 110)
    for k in range(400):
        snapshot_s = usual_s if k % every else usual_s * slow
        usual = accustomed(usual, load, Done(TOP, 1, 1), Took(0.003, 0.003, 0.002, snapshot_s))
    known_s = load.present * usual.snapshot
    assert slowness(known_s, usual_s) == pytest.approx(1.0, abs=0.2)
    assert slowness(known_s, usual_s * slow) == pytest.approx(slow, rel=0.2)
    assert slowness(known_s, 0.1 * usual_s) == 1.0


@given(load=loads, took=st.builds(Took, *[st.floats(1e-4, 0.1)] * 5), many=st.floats(1.0, 1000.0))
def test_one_control_cycle_moves_little_of_what_is_usual(load: Load, took: Took, many: float) -> None:
    done = Done(TOP, 1, 1)
    before = accustomed(Costs(), load, done, took)
    after = accustomed(before, load, done, Took(*(many * each_s for each_s in took)))
    assert all(one <= other <= SLIP * one for one, other in zip(before, after, strict=True))


@given(program_s=st.floats(1e-3, 0.05), share=st.floats(0.0, 0.5))
def test_a_program_that_had_less_time_than_it_takes_is_not_taken_to_be_quicker(program_s: float, share: float) -> None:
    load, done = Load(260, 110), Done(TOP, 1, 0)
    costs = learned(Costs(), load, Done(TOP, 1, 1), Took(0.003, program_s, 0.002, 0.002))
    assert learned(costs, load, done, Took(0.003, share * need_s(costs, load, 1), 0.002)).program >= costs.program


@given(costs=costs_, load=loads, left_s=st.floats(0.0, 0.1), slow=st.floats(1.0, 20.0))
def test_a_slow_processor_never_means_more(costs: Costs, load: Load, left_s: float, slow: float) -> None:
    assert fitting(costs.times(slow), load, left_s, TOP) <= fitting(costs, load, left_s, TOP)


@given(costs=costs_, load=loads, before_s=st.floats(0.0, 0.03))
def test_what_is_usual_fits_into_its_limit(costs: Costs, load: Load, before_s: float) -> None:
    assert fitting(costs, load, limit_s(costs, load, TOP, before_s, prompt_s=0.0) - before_s, TOP) == TOP


def test_a_program_that_is_late_now_and_then_costs_nothing_else() -> None:
    machine, levels = Machine(0.0002, 0.012), []
    for k in range(500):
        machine.program_s = 0.2 if k % 5 == 0 else 0.012
        machine.cycle()
        levels.append(machine.ladder.level)
    assert set(levels) == {TOP}


def test_who_was_held_up_once_is_not_taken_to_be_slow() -> None:
    """A process that was suspended for a minute: its estimates are back within seconds."""
    machine = Machine(0.0002, 0.010)
    machine.run(100)
    machine.costs = learned(machine.costs, machine.load, Done(TOP, 1, 1), Took(60.0, 60.0, 60.0))
    assert machine.cycle() < BUDGET_S
    assert machine.run(200)[-1][0] == TOP
