"""What a results folder says: every run once, failed ones in no mean, JSON and CSV alike; plots and page from it."""

from __future__ import annotations

import csv
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from compared import PID, SETTINGS, put, report, run

from gameopt_sumo.baselines.report import Report
from gameopt_sumo.compare import plots
from gameopt_sumo.compare.computation import Computation, Decision
from gameopt_sumo.compare.page import Made, page
from gameopt_sumo.compare.results import OWN_FIELDS, at, change, collided, figure, gather, whole, write
from gameopt_sumo.compare.runs import Place, Run
from gameopt_sumo.compare.views import ablations, views

NOW = datetime(2026, 1, 2, tzinfo=UTC)


def test_an_entry_is_the_report_with_the_method_and_the_manager(tmp_path: Path) -> None:
    put(tmp_path, run("coop-fifo"), report())
    (entry,) = gather(tmp_path, SETTINGS)
    assert set(entry) == {*Report.__struct_fields__, *OWN_FIELDS}, "null where a method lacks a field"
    assert {name: value for name, value in entry.items() if value is not None or name in OWN_FIELDS} == report() | {
        "method": "coop-fifo",
        "flow_veh_h": 10000.0,
        "ratio": 1.0,
        "seed": 101,
        "run": "coop-fifo-10000-ratio1-seed101",
        "knob": None,
        "value": None,
        "manager_pid": PID,
        "machine": None,
        "failed": None,
    }


def test_what_was_interrupted_or_is_of_another_schema_is_no_result(tmp_path: Path) -> None:
    place = Place(tmp_path, SETTINGS)
    put(tmp_path, run(seed=101), report(duration_s=22.0))
    put(tmp_path, run(seed=102), report(schema="gameopt-report/2"))
    put(tmp_path, run(seed=103))
    (put(tmp_path, run(seed=104)) / "report.json").write_text('{"schema": "gameopt-rep')
    put(tmp_path, run(seed=105), report())
    assert [entry["seed"] for entry in gather(tmp_path, SETTINGS)] == [105]
    assert [place.done(run(seed=seed)) for seed in range(101, 106)] == [False] * 4 + [True]


def test_a_failed_run_is_listed_and_in_no_mean(tmp_path: Path) -> None:
    put(tmp_path, run(seed=101), report(fuel_g=10.0))
    put(tmp_path, run(seed=102), failed="the manager ran out of road")
    put(tmp_path, run(seed=103), report(fuel_g=14.0))
    entries = gather(tmp_path, SETTINGS)
    assert [entry["failed"] for entry in entries] == [None, "the manager ran out of road", None]
    assert entries[1]["fuel_g"] is None
    assert entries[1].keys() == entries[0].keys()

    fuel = figure(whole(entries), "fuel_g")
    assert fuel is not None
    assert (fuel.mean, fuel.seeds) == (12.0, 2)
    text = page(entries, SETTINGS, None, Made(["gameopt-sumo compare"], NOW, ()))
    assert "- `coop-10000-ratio1-seed102`: the manager ran out of road" in text
    assert "| 10000 | coop | 2 |" in text


def test_the_interval_is_students() -> None:
    entries = [{"failed": None, "x": value} for value in (1.0, 2.0, 3.0)]
    found = figure(entries, "x")
    assert found is not None
    assert found.half == pytest.approx(4.302653 / math.sqrt(3))  # t(0.975, 2 degrees of freedom), deviation 1
    assert figure(entries[:1], "x") == (1.0, None, 1)
    assert figure(entries, "y") is None


def test_changes_are_taken_seed_by_seed(tmp_path: Path) -> None:
    for seed, mine, theirs in ((101, 30.0, 20.0), (102, 90.0, 45.0), (103, 7.0, None)):
        put(tmp_path, run("coop", seed=seed), report(throughput_veh_min=mine))
        if theirs is not None:
            put(tmp_path, run("fixed", seed=seed), report(throughput_veh_min=theirs))
    entries = gather(tmp_path, SETTINGS)
    found = change(whole(entries, method="coop"), whole(entries, method="fixed"), "throughput_veh_min")
    assert found is not None
    assert (found.mean, found.seeds) == (0.75, 2)


def test_json_and_csv_say_the_same(tmp_path: Path) -> None:
    put(tmp_path, run(), report(time_to_goal_s__mean=11.25))
    put(tmp_path, run("fixed", seed=102), report(control_cycle=None))
    put(tmp_path, run("fixed", seed=103), failed="no lights")
    entries = gather(tmp_path, SETTINGS)
    write(tmp_path, entries)
    assert json.loads((tmp_path / "results.json").read_text()) == entries
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == [entry["run"] for entry in entries]
    for row, entry in zip(rows, entries, strict=True):
        for path in ("time_to_goal_s.mean", "by_class.truck.fuel_g", "control_cycle.p99_ms", "seed"):
            assert (float(row[path]) if row[path] else None) == at(entry, path)
    assert rows[2]["failed"] == "no lights"


def test_collisions_of_every_method_are_on_the_page(tmp_path: Path) -> None:
    put(tmp_path, run("coop"), report())
    put(tmp_path, run("fixed"), report(safety__collisions_geometric=2))
    put(tmp_path, run("stop-sign"), report(safety__teleports=1))
    entries = gather(tmp_path, SETTINGS)
    assert [entry["method"] for entry in collided(entries)] == ["fixed", "stop-sign"]
    text = page(entries, SETTINGS, None, Made([], NOW, ()))
    assert "- `fixed-10000-ratio1-seed101`: 0 by SUMO, 2 by geometry; 0 teleports" in text
    assert "`coop-10000-ratio1-seed101`" not in text


def test_a_figure_that_not_every_seed_has_says_so(tmp_path: Path) -> None:
    for seed, fuel in ((101, 10.0), (102, None), (103, 10.0)):
        put(tmp_path, run(seed=seed), report(fuel_g=fuel))
    text = page(gather(tmp_path, SETTINGS), SETTINGS, None, Made([], NOW, ()))
    assert "| 10.0 ± 0.0 (2 of 3) |" in text
    assert "12.00 ± 0.00 |" in text


def page_of(out: Path, *runs: Run, **settings: Any) -> str:
    for each in runs:
        put(out, each, report())
    made_with = msgspec.structs.replace(SETTINGS, **settings)
    return page(gather(out, made_with), made_with, None, Made([], NOW, ()))


def test_the_page_says_where_lights_were_not_searched_for(tmp_path: Path) -> None:
    lights = run("fixed", 4000.0), run("actuated", 4000.0)  # Webster has 13 plans for the one, 14 for the other
    none = "lights these are Webster's plans only, no search"
    assert f"Of fixed and actuated {none}" in page_of(tmp_path / "13", *lights, tuning_budget=13)
    assert f"Of actuated {none}" in page_of(tmp_path / "14", *lights, tuning_budget=14)
    assert "Webster" not in page_of(tmp_path / "40", *lights, tuning_budget=40)
    assert "plans tried" not in page_of(tmp_path / "no lights", run("coop"))


def test_the_page_says_whether_arrivals_are_held_out(tmp_path: Path) -> None:
    assert "Not held out" in page_of(tmp_path / "seen", run(seed=101), run(seed=301))
    assert "The arrivals are held out" in page_of(tmp_path / "unseen", run(seed=301))


def test_our_box_has_claims_of_its_own(tmp_path: Path) -> None:
    text = page_of(tmp_path, run("coop"), run("coop@box"), run("stop-sign"))
    assert "## The paper's claims, and `coop@box`" in text
    assert "What the areas alone bring shows beside `coop@box`" in text
    assert "- `coop@box`: the manager with the profile `default`, box geometry" in text


def test_what_is_not_switched_off_alone_is_named(tmp_path: Path) -> None:
    off = [run(f"ablation-{name}@areas") for name in ("programs", "waiting-upstream")]
    assert "its difference from `ablation-programs`" in page_of(tmp_path / "both", run("coop@areas"), *off)
    assert "its difference from" not in page_of(tmp_path / "one", run("coop@areas"), off[0])


def test_shades_stay_apart_without_colour() -> None:
    def lightness(shade: str) -> float:
        """L* of CIELAB, 0 to 100."""
        channels = (int(shade[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
        luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
        return 116.0 * luminance ** (1.0 / 3.0) - 16.0 if luminance > 0.008856 else 903.3 * luminance

    shades = sorted(map(lightness, plots._SHADES))
    assert min(b - a for a, b in pairwise(shades)) > 5.0
    assert shades[-1] < 70.0, "on white"


def folder_of_everything(out: Path) -> None:
    for seed in (101, 102):
        for method in ("coop", "fixed", "stop-sign"):
            for flow in (2000.0, 10000.0):
                put(out, run(method, flow, seed=seed), report(throughput_veh_min=flow / 60.0 + seed - 100))
            for ratio in (1.0, 4.0):
                put(out, run(method, 5200.0, ratio, seed), report())
        for value in (0.0, 1.0):
            put(out, run("coop", 8000.0, 1.0, seed, knob="lambda", value=value), report())
        for method in ("coop@areas", "ablation-programs@areas"):
            put(out, run(method, seed=seed), report())


def test_every_experiment_is_a_view_of_its_own(tmp_path: Path) -> None:
    folder_of_everything(tmp_path)
    entries = gather(tmp_path, SETTINGS)
    by_name = {view.name: view for view in views(entries)}
    assert list(by_name) == ["flows", "unbalanced-5200", "lambda-8000"]
    assert list(by_name["flows"].series["fixed"]) == [2000.0, 5200.0, 10000.0]
    assert list(by_name["unbalanced-5200"].series["coop"]) == [1.0, 4.0]
    assert list(by_name["lambda-8000"].series["coop"]) == [0.0, 1.0]
    assert list(ablations(entries)[10000.0]) == ["coop@areas", "ablation-programs@areas"]


def test_plots_are_png_and_svg_with_a_look_for_each_method(tmp_path: Path) -> None:
    folder_of_everything(tmp_path)
    entries = [entry for entry in gather(tmp_path, SETTINGS) if entry["ratio"] == 1.0 and entry["knob"] is None]
    computation = Computation([Decision(n, 0.1 * n, 0.2 * n) for n in (10, 50, 100)])
    names = plots.draw(tmp_path, entries, computation)
    assert {"flows-throughput", "flows-time-to-goal-max", "ablation-10000", "computation"} <= set(names)
    assert "flows-emergency-time" not in names, "no report has emergency vehicles"
    for name in names:
        assert (tmp_path / "plots" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert ET.parse(tmp_path / "plots" / f"{name}.svg").getroot().tag.endswith("svg")
    looks = [(look["marker"], look["linestyle"]) for look in plots._styles([f"m{k}" for k in range(12)]).values()]
    assert len(set(looks)) == 12

    text = page(entries, SETTINGS, computation, Made(["gameopt-sumo compare"], NOW, names))
    assert all(f"plots/{name}.png" in text for name in names)
    assert "| 2000 | fixed | 2 | 50 ± 0 |" in text


@pytest.mark.parametrize(
    ("term", "grows"), [("n", lambda n: n), ("n log2 n", lambda n: n * math.log2(n)), ("n^2", lambda n: n * n)]
)
def test_the_growth_that_is_there_fits_best(term: str, grows: Callable[[float], float]) -> None:
    points = [Decision(n, 0.5 + 0.002 * grows(n), 1.0) for n in (10, 50, 100, 200)]
    fits = {growth.term: growth for growth in Computation(points).growths}
    assert fits[term][1:] == pytest.approx((0.5, 0.002, 1.0))
    assert all(growth.r_squared < 0.9999 for name, growth in fits.items() if name != term)
    assert Computation(points[:2]).growths == []
