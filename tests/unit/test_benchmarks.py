"""What the benchmark says beside the stages: ratios of two ways, and how times grow."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from rich.console import Console

from gameopt_im.benchmarks import growth, moments, pairs, programs, ratios, solvers
from gameopt_im.benchmarks.pairs import Ratio, Timed
from gameopt_im.benchmarks.programs import Programs
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.program import QP, csc, diagonal
from gameopt_im.core.snapshot import Floats
from gameopt_im.options import ServeOptions
from gameopt_sumo.network import packaged_map

COUNTS = (50, 100, 200, 400, 700, 1000)


def of(seconds: list[float], wrong: str | None = None) -> list[Timed]:
    return [Timed(each, wrong) for each in seconds]


def shown(table: object) -> str:
    text = io.StringIO()
    Console(width=200, file=text).print(table)
    return text.getvalue()


@pytest.fixture(scope="module")
def options() -> ServeOptions:
    return ServeOptions(map=packaged_map(), parameters=Parameters(), workers=0, clock="lockstep")


@pytest.fixture(scope="module")
def compared(options: ServeOptions) -> list[Ratio]:
    """Six moments of twelve vehicles: one pool is enough, workers have their own tests."""
    return asyncio.run(ratios.compare(options, 12, samples=8))


# Growth


@pytest.mark.parametrize(
    ("law", "verdict"),
    [
        (lambda n: 0.02 * n, growth.NO_FASTER),
        (lambda n: 0.02 * n * np.log(n), growth.NO_FASTER),
        (lambda n: 0.02 * n**1.5, growth.FASTER),
        (lambda n: 1e-4 * n**2, growth.FASTER),
    ],
    ids=["n", "n log n", "n^1.5", "n^2"],
)
def test_what_grows_faster_than_n_log_n_is_told(law: Callable[[Floats], Floats], verdict: str) -> None:
    noise = 1.0 - 1e-3 * np.array([1, 2, 0, 2, 1, 2])  # falling at the end, or an exact n log n would be undecided
    fit = growth.growth("stage", COUNTS, COUNTS, (law(np.array(COUNTS, dtype=float)) * noise).tolist())
    assert fit.verdict == verdict or (verdict == growth.NO_FASTER and abs(fit.beyond.value) < 1e-3)


@pytest.mark.parametrize("power", [0.5, 1.0, 1.3, 2.0])
def test_the_fit_recovers_an_exponent_and_its_uncertainty(power: float) -> None:
    rng = np.random.default_rng(1)
    n = np.array(COUNTS, dtype=float)
    hits = 0
    for _ in range(200):
        times = 0.03 * n**power * np.exp(rng.normal(0.0, 0.1, len(n)))
        fit = growth.growth("stage", COUNTS, (n / 3.0).tolist(), times.tolist())
        hits += fit.exponent.low <= power <= fit.exponent.high
        assert fit.exponent.value == pytest.approx(power, abs=0.25)
        assert fit.by_uncleared is not None
        assert fit.by_uncleared.value == pytest.approx(fit.exponent.value)
    assert 180 <= hits <= 199  # 95 % of 200, and no certainty


def test_the_better_of_two_laws_is_the_nearer_one() -> None:
    n = np.array(COUNTS, dtype=float)
    fit = growth.growth("stage", COUNTS, COUNTS, (0.004 * n * np.log(n)).tolist())
    assert fit.n_log_n_ms == pytest.approx(0.004)
    assert fit.spread_n_log_n == pytest.approx(0.0, abs=1e-9)
    assert fit.spread_n_squared > 0.5
    assert fit.last == pytest.approx(np.log(1000 * np.log(1000) / (700 * np.log(700))) / np.log(1000 / 700))


def test_two_numbers_of_vehicles_are_no_growth() -> None:
    assert growth.growths((60, 260), (8, 112), [{"auction": 1.0}, {"auction": 4.0}]) == []


def test_a_stage_that_did_not_run_is_left_out() -> None:
    medians = [{"auction": float(n), "programs": 0.0} for n in COUNTS]
    assert [fit.stage for fit in growth.growths(COUNTS, COUNTS, medians)] == ["auction"]


# Pairs


def test_a_ratio_is_the_median_of_pairs_whatever_the_machine_does_meanwhile() -> None:
    load = np.array([1.0, 5.0, 2.0, 9.0, 1.0, 3.0, 7.0])
    found = pairs.ratio("60 vehicles", "a / b", of((0.3 * load).tolist()), of((0.1 * load).tolist()))
    assert found.median == pytest.approx(3.0)
    assert found.low == pytest.approx(3.0)
    assert found.second_ms == pytest.approx(300.0)


def test_few_pairs_have_no_interval() -> None:
    found = pairs.ratio("60 vehicles", "a / b", of([1.0, 2.0]), of([1.0, 1.0]))
    assert (found.median, found.low, found.high) == (1.5, None, None)


def test_a_way_whose_answers_are_wrong_has_no_ratio() -> None:
    found = pairs.ratio("60 vehicles", "a / b", of([1.0, 1.0], "residual 2e-02 m/s"), of([1.0, 1.0]))
    assert found.median is None
    assert found.failed == "2 of 2 off: residual 2e-02 m/s"
    assert "residual 2e-02 m/s" in shown(pairs.table([found]))


def test_one_wrong_answer_of_many_is_left_out_and_counted() -> None:
    first = [*of([2.0] * 19), *of([900.0], "no solution")]
    found = pairs.ratio("60 vehicles", "a / b", first, of([1.0] * 20))
    assert (found.median, found.pairs, found.off) == (2.0, 19, 1)


def test_every_way_goes_first_as_often_as_the_others() -> None:
    ran: list[str] = []

    def way(name: str) -> Callable[[int], Timed]:
        def run(_state: int) -> Timed:
            ran.append(name)
            return Timed(1.0, None)

        return run

    pairs.in_turn(range(4), {"a": way("a"), "b": way("b")})
    assert "".join(ran) == "abbaabba"


# Programs


def program() -> Programs:
    """min 1/2 |x|^2 - x_1 - x_2 over x <= 0.5: x = (0.5, 0.5), 1/4 - 1 = -0.75."""
    at = np.arange(2)
    a = csc((2, 2), at, at, np.ones(2))
    qp = QP(diagonal(np.ones(2)), -np.ones(2), a, np.full(2, -np.inf), np.full(2, 0.5))
    return Programs([qp], -0.75, 1e-3, lambda: [np.full(2, 0.5)])


@pytest.mark.parametrize(
    ("answers", "wrong"),
    [
        ([np.array([0.5, 0.5])], None),
        ([None], "no solution"),
        ([np.array([0.5, 0.6])], "residual 1.0e-01"),
        ([np.array([0.5, np.nan])], "residual nan"),
        ([np.array([0.2, 0.5])], "objective off"),
    ],
)
def test_an_answer_is_looked_at_before_its_time_counts(answers: programs.Answers, wrong: str | None) -> None:
    said = program().wrong(answers)
    assert said == wrong if wrong is None else said is not None and said.startswith(wrong)


@pytest.mark.parametrize("name", solvers.OPTIONAL)
def test_other_solvers_solve_it(name: str) -> None:
    pytest.importorskip(name)
    state = program()
    assert state.wrong([solvers.OPTIONAL[name](state.qps[0])]) is None


@pytest.mark.parametrize("name", solvers.OPTIONAL)
def test_a_solver_that_is_not_installed_is_a_line(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solvers, "installed", lambda solver: None if solver == name else "1.0")
    there = {each: lambda _qp: np.full(2, 0.5) for each in solvers.OPTIONAL}
    monkeypatch.setattr(solvers, "OPTIONAL", there)
    lines = {each.compares: each for each in programs.solver_ratios("60 vehicles", "programs", "mine", [program()] * 6)}
    for solver in there:
        line = lines[f"{solver} / mine, programs"]
        assert (line.failed is None) == (solver != name)
    assert lines[f"{name} / mine, programs"].failed == f"not installed: {solvers.EXTRA}"


# The whole comparison, on real control cycles


def test_all_workers_decide_the_same_and_all_ways_solve(compared: list[Ratio]) -> None:
    found = {each.compares: each for each in compared}
    wanted = [ratios.LITERAL, ratios.SAME_ROWS, programs.COLD, programs.SPLITTING, "1 worker / none, whole decision"]
    for name in wanted:
        assert found[name].failed is None, found[name]
        assert found[name].median is not None
        assert found[name].off == 0
    for solver in solvers.OPTIONAL:
        for name in ("active set, horizon programs", "OSQP, the paper's program, reduced rows"):
            line = found[f"{solver} / {name}"]
            if solvers.installed(solver):
                assert line.failed is None, line
                assert line.median is not None
                assert line.median > 0.0
            else:
                assert line.failed == f"not installed: {solvers.EXTRA}"


def test_setting_up_for_every_program_takes_longer(compared: list[Ratio]) -> None:
    cold = next(each for each in compared if each.compares == programs.COLD)
    assert cold.median is not None
    assert cold.median > 1.0


def test_full_rows_charge_no_less_than_reduced_ones(compared: list[Ratio]) -> None:
    rows = next(each for each in compared if each.compares == ratios.SAME_ROWS)
    charged = float(rows.note.split()[3])
    assert charged >= 1.0


def test_ratios_are_read_back_and_shown(compared: list[Ratio]) -> None:
    assert msgspec.json.decode(msgspec.json.encode(compared), type=list[Ratio]) == compared
    text = shown(pairs.table(compared))
    assert ratios.LITERAL in text
    assert "12 vehicles" in text


def test_what_is_caught_is_the_state_before_the_decision(options: ServeOptions) -> None:
    """The book as the auction saw it: without what the same control cycle granted."""
    watched = asyncio.run(moments.watch(options, 12, (0,), 4))
    assert watched.moments
    for moment in watched.moments:
        uncleared = {vehicle for vehicle in moment.caught.snapshot.ids if vehicle not in moment.caught.book.held}
        assert len(moment.caught.jobs[0].slots) <= len(uncleared)
        assert moment.decision_s >= moment.planning_s > 0.0
    assert all(each.wrong is None for each in watched.decisions["0"])
