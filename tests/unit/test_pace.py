"""What control cycles try under the wall clock: the real manager short of time, and its account of times passed in."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from typing import Any

import pytest
from tracking import ROADS
from watched import STOP_SIGN_TEXT

from gameopt_im import config
from gameopt_im.core.budget import Effort, Load, Took
from gameopt_im.manager import Manager, Outcome
from gameopt_im.options import ServeOptions
from gameopt_im.pace import Pace
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import solver_of
from gameopt_wire.messages import Clock

LOAD = Load(60, 30)
SWIFT, SLOW = Took(0.001, 0.005, 0.001), Took(0.090, 0.040, 0.001)
SHARED_PART = 0.3
PRESENT = 12
NO_TIME = "[service]\nbudget_s = 1e-9"


def options(text: str = "", clock: Clock = "wall", **changes: Any) -> ServeOptions:
    return ServeOptions(map=ROADS, parameters=config.parse(text), clock=clock, workers=0, **changes)


def driven(asked: ServeOptions, cycles: int, left_s: float | None) -> list[Outcome]:
    """A junction of two roads, crossed for a while by vehicles that obey."""

    async def drive() -> list[Outcome]:
        traffic, outcomes = Rehearsal(ROADS, PRESENT), []
        async with solver_of(asked) as solver:
            manager = Manager(asked, 1, solver)
            for cycle in range(1, cycles):
                messages = traffic.messages(cycle / 10)
                outcomes.append(await manager.control_cycle(cycle, cycle / 10, messages, left_s))
                manager.published()
                traffic.obey(outcomes[-1].commands)
        return outcomes

    return asyncio.run(drive())


@pytest.mark.parametrize(("profile", "left_out"), [("default", 8), ("paper", 7)])
def test_without_time_everybody_is_still_commanded_and_crosses(profile: Any, left_out: int) -> None:
    outcomes = driven(options(NO_TIME, profile=profile), 200, 0.08)
    reports = [outcome.report for outcome in outcomes]
    assert all(report.commands == report.vehicles == PRESENT for report in reports)
    assert {report.candidates for report in reports if report.uncleared} == {1}
    assert reports[-1].qp_solved_total == 0
    assert sum(report.cleared > 0 for report in reports) > 50
    assert all(report.withdrawn == 0 for report in reports)
    planned = sum(report.uncleared > 0 for report in reports)
    assert (reports[-1].dropped_total, reports[-1].unsolved_total) == (
        planned * left_out - first_drop(reports),
        planned,
    )


def first_drop(reports: list[Any]) -> int:
    """Nothing is known of costs in the first control cycle, so all is tried."""
    return 0 if reports[0].unsolved_total else reports[0].dropped_total


def test_without_time_for_programs_the_delay_decides_also_where_the_objective_would(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Pace, "effort", lambda *_: Effort(7, programs=False))
    monkeypatch.setattr(Pace, "still", lambda *_: Effort(7, programs=False))
    by_delay = driven(options(), 100, 0.08)
    by_objective = driven(options('[planner]\nselection = "objective"'), 100, 0.08)
    assert [outcome.commands for outcome in by_objective] == [outcome.commands for outcome in by_delay]
    assert len({outcome.report.selected for outcome in by_delay}) > 2


@pytest.mark.parametrize(("profile", "vectors"), [("default", 0), ("paper", 1)])
def test_a_profile_asks_once_more_before_it_makes_its_sequences(
    profile: Any, vectors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pace, "still", lambda *_: Effort(vectors, programs=False))
    reports = [outcome.report for outcome in driven(options(profile=profile), 100, 0.08)]
    assert {report.candidates for report in reports if report.uncleared} == {1}
    assert reports[-1].qp_solved_total == 0


def test_the_stop_sign_leaves_nothing_out_for_it_has_one_order() -> None:
    outcomes = driven(options(f"{STOP_SIGN_TEXT}\n{NO_TIME}"), 60, 0.08)
    assert max(outcome.report.uncleared for outcome in outcomes) > 3
    assert (outcomes[-1].report.dropped_total, outcomes[-1].report.unsolved_total) == (0, 0)


def test_without_the_incumbent_the_first_weight_vector_remains() -> None:
    outcomes = driven(options(NO_TIME + "\n[planner]\nincumbent = false"), 60, 0.08)
    assert {outcome.report.selected for outcome in outcomes[1:] if outcome.report.uncleared} == {0}


def test_one_that_begins_after_the_next_grid_point_tries_the_incumbent_alone() -> None:
    late = driven(options(), 40, -0.03)
    assert {outcome.report.selected for outcome in late if outcome.report.uncleared} == {-1}
    assert late[-1].report.unsolved_total == sum(outcome.report.uncleared > 0 for outcome in late)


def test_in_lock_step_no_budget_is_looked_at() -> None:
    usual, short = (driven(options(text, "lockstep"), 60, None) for text in ("", NO_TIME))
    assert [outcome.commands for outcome in usual] == [outcome.commands for outcome in short]
    assert short[-1].report.dropped_total == short[-1].report.unsolved_total == 0
    assert max(outcome.report.candidates for outcome in short) > 1


def test_a_late_start_says_nothing_about_the_next_control_cycle() -> None:
    pace = Pace(options())
    pace.effort(LOAD, 0.001, 0.08)
    pace.learn(SWIFT, 9, 1, late=False)
    assert pace.effort(LOAD, 0.001, 0.001) == (0, False)
    assert (pace.dropped, pace.unsolved) == (8, 1)
    pace.learn(SWIFT, 0, 0, late=False)
    assert pace.effort(LOAD, 0.001, 0.08) == (8, True)
    assert (pace.dropped, pace.unsolved) == (8, 1)


def test_one_control_cycle_held_up_says_nothing_about_the_next() -> None:
    pace = Pace(options())
    pace.effort(LOAD, 0.001, 0.08)
    pace.learn(SWIFT, 9, 1, late=False)
    assert pace.effort(LOAD, 3.0, 0.08) == (0, False)
    pace.learn(SWIFT, 0, 0, late=False)
    assert pace.effort(LOAD, 0.001, 0.08) == (8, True)


def usual(pace: Pace, load: Load, took: Took) -> None:
    """Some control cycles that take the same."""
    for _ in range(50):
        assert pace.effort(load, took.snapshot, 0.08, took.snapshot) == (8, True)
        assert pace.still(SHARED_PART * took.sequences) == (8, True)
        pace.deadline_s(took.sequences, 0.04)
        pace.learn(took, 9, 1, late=False)


def test_while_the_processor_is_slow_as_little_is_tried_and_nothing_is_learned_from_it() -> None:
    pace, took = Pace(options()), Took(0.003, 0.003, 0.002, 0.002)
    usual(pace, LOAD, took)
    assert pace.effort(LOAD, 0.010, 0.08, 0.010) == (0, False)  # there would be time for all of it, were it not slow
    pace.learn(Took(0.005, 0.0, 0.010, 0.010), 0, 0, late=False)
    usual(pace, LOAD, took)
    assert (pace.dropped, pace.unsolved) == (8, 1)


def test_a_processor_that_becomes_slow_within_the_auction_is_noticed_before_the_sequences() -> None:
    pace, took = Pace(options()), Took(0.003, 0.003, 0.002, 0.002)
    usual(pace, LOAD, took)
    assert pace.effort(LOAD, 0.002, 0.08, 0.002) == (8, True)
    assert pace.still(3 * SHARED_PART * 0.003) == (1, False)
    assert (pace.dropped, pace.unsolved) == (7, 1)
    pace.learn(Took(0.012, 0.0, 0.020, 0.002), 0, 0, late=False)
    usual(pace, LOAD, took)
    assert (pace.dropped, pace.unsolved) == (7, 1)


def test_what_takes_long_as_usual_is_not_cut_short_for_it() -> None:
    usual(Pace(options()), Load(520, 380), Took(0.014, 0.010, 0.010, 0.006))


@pytest.mark.parametrize(("text", "tried"), [("", (0, False)), ("[service]\nprompt_s = 0.03", (8, True))])
def test_a_control_cycle_may_always_take_what_counts_as_prompt(text: str, tried: tuple[int, bool]) -> None:
    pace = Pace(options(text))
    usual(pace, LOAD, Took(0.0005, 0.0005, 0.0005, 0.001))
    assert pace.effort(LOAD, 0.009, 0.08, 0.009) == tried


def test_programs_end_with_what_a_control_cycle_may_take() -> None:
    pace = Pace(options())
    usual(pace, LOAD, Took(0.003, 0.003, 0.002, 0.002))
    pace.effort(LOAD, 0.002, 0.08, 0.002)
    assert pace.deadline_s(0.010, 0.04) == pytest.approx(
        0.001
    )  # 1.5 * 10 ms, of which 2 + 10 are over and 2 come after
    assert pace.deadline_s(0.020, 0.04) == 0.0  # the processor became slow in the auction


@pytest.mark.parametrize(
    ("programs_s", "may_take_s"),
    [(0.003, 0.006), (0.0001, 0.002)],  # a fifth of what is prompt for a control cycle may always be taken
)
def test_programs_may_take_twice_what_they_usually_take_together(programs_s: float, may_take_s: float) -> None:
    pace, took = Pace(options()), Took(0.003, programs_s, 0.002, 0.002)
    usual(pace, LOAD, took)
    pace.effort(LOAD, took.snapshot, 0.08, took.snapshot)
    assert pace.deadline_s(took.sequences, 0.04) == pytest.approx(may_take_s)


def test_programs_without_time_leave_what_is_usual_as_it_was() -> None:
    pace, took = Pace(options()), Took(0.003, 0.003, 0.002, 0.002)
    usual(pace, LOAD, took)
    for _ in range(30):
        pace.effort(LOAD, 0.002, 0.08, 0.002)
        assert pace.deadline_s(0.050, 0.04) == 0.0
        pace.learn(took._replace(programs=0.0003), 9, 0, late=True)
    pace.effort(LOAD, 0.002, 0.08, 0.002)
    assert pace.deadline_s(0.003, 0.04) >= took.programs


def test_all_programs_of_a_control_cycle_are_usual_where_all_are_solved() -> None:
    pace, took = Pace(options(profile="paper")), Took(0.001, 0.028, 0.002, 0.001)
    for _ in range(50):
        pace.effort(LOAD, 0.001, 0.08, 0.001)
        pace.still(SHARED_PART * 0.001)
        assert pace.deadline_s(0.001, 0.04) >= took.programs
        pace.learn(took, 8, 8, late=False)
    assert pace.dropped == pace.unsolved == 0


def test_without_programs_as_many_sequences_as_fit_are_usual() -> None:
    pace, load = Pace(options()), Load(260, 110)
    tried = []
    for _ in range(200):
        tried.append(pace.effort(load, 0.010, 0.08, 0.008))
        sequences = tried[-1].candidates + 1
        pace.still(0.006)
        pace.deadline_s(0.002 * (sequences + 3), 0.04)
        pace.learn(Took(0.002 * (sequences + 3), 0.035, 0.004, 0.008), 9 * tried[-1].programs, 0, late=True)
    assert tried[-1] == (8, False)


def test_one_slow_auction_makes_no_room_for_the_next_one() -> None:
    pace, took = Pace(options()), Took(0.003, 0.003, 0.002, 0.002)
    usual(pace, LOAD, took)
    pace.effort(LOAD, 0.002, 0.08, 0.002)
    pace.learn(took._replace(sequences=0.030, rest=0.020), 0, 0, late=False)
    assert pace.effort(LOAD, 0.002, 0.08, 0.002) == (8, True)
    assert pace.deadline_s(0.003, 0.04) >= took.programs
    assert pace.deadline_s(0.020, 0.04) == 0.0


def test_candidates_go_before_the_program_and_come_back_step_by_step() -> None:
    pace = Pace(options())
    pace.effort(LOAD, 0.001, 0.08)
    for _ in range(2):
        pace.learn(Took(0.090, 0.005, 0.001), 9, 1, late=False)
    candidates, programs = pace.effort(LOAD, 0.001, 0.08)
    assert 0 < candidates < 8
    assert programs
    tried = [candidates]
    for _ in range(400):
        pace.learn(Took(0.0001 * (tried[-1] + 1), 0.005, 0.001), tried[-1] + 1, 1, late=False)
        tried.append(pace.effort(LOAD, 0.001, 0.08).candidates)
    assert tried[-1] == 8
    assert {after - before for before, after in pairwise(tried)} <= {0, 1, 2, 4}


def test_programs_are_due_before_what_follows_them() -> None:
    pace = Pace(options())
    pace.effort(LOAD, 0.001, 0.08)
    assert pace.deadline_s(0.002, 0.04) == 0.04
    for _ in range(2):  # what happens twice is usual
        pace.learn(Took(0.001, 0.005, 0.010), 9, 1, late=False)
        pace.effort(LOAD, 0.030, 0.08)
    assert 0.0 < pace.deadline_s(0.002, 0.04) <= 0.06 - 0.030 - 0.002 - 0.5 * 0.010
    assert pace.deadline_s(0.050, 0.04) == 0.0


def test_programs_that_busy_workers_never_began_are_taken_to_be_late_not_quick() -> None:
    pace = Pace(options())
    tried = []
    for _ in range(30):
        tried.append(pace.effort(LOAD, 0.001, 0.08).programs)
        pace.deadline_s(0.001, 0.04)
        pace.learn(Took(0.001, 0.0001, 0.001), 9, 0, late=True)
    assert tried[0]
    assert not all(tried)


def test_programs_without_a_solution_are_not_taken_to_be_late() -> None:
    pace = Pace(options())
    for _ in range(100):
        assert pace.effort(LOAD, 0.001, 0.08).programs
        pace.deadline_s(0.001, 0.04)
        pace.learn(Took(0.001, 0.0001, 0.001), 9, 0, late=False)


def test_what_is_short_is_said_once_per_change(capsys: pytest.CaptureFixture[str]) -> None:
    pace = Pace(options())
    for took in (SWIFT, *[SLOW] * 50, *[SWIFT] * 2000):
        pace.effort(LOAD, 0.001, 0.08)
        pace.learn(took, 9, 1, late=False)
    said = capsys.readouterr().out
    assert "short of time" in said
    assert said.count("time to spare") == 5  # 1, 2, 4, 8 and 9 sequences
    assert len(said.splitlines()) < 15
