"""Runs as processes: one that fails is on record as failed and tried again; Ctrl-C ends everything."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from compared import SETTINGS, put, report, run
from rich.console import Console

from gameopt_sumo.baselines.plan import Plan, write_plan
from gameopt_sumo.compare import command, processes, schedule
from gameopt_sumo.compare.methods import named
from gameopt_sumo.compare.plans import at_bounds, needed, plan_file
from gameopt_sumo.compare.processes import ProcessError, Processes, Stopped, cores, machine
from gameopt_sumo.compare.results import gather
from gameopt_sumo.compare.runs import PROBE, Place, perform

QUIET = Console(quiet=True)
FOREVER = [sys.executable, "-c", "import signal; signal.pause()"]


def test_what_is_whole_is_not_run_again(tmp_path: Path) -> None:
    put(tmp_path, run("all-way-stop"), report())
    assert schedule.carry_out(Place(tmp_path, SETTINGS), [run("all-way-stop")], 1, Processes(), QUIET) == 0
    assert not (tmp_path / "arrivals").exists()


def test_a_run_that_fails_is_on_record_with_its_last_words(tmp_path: Path) -> None:
    place = Place(tmp_path, SETTINGS)
    perform(run("all-way-stop"), place, Processes())  # nobody has written its arrivals
    (entry,) = gather(tmp_path, SETTINGS)
    assert "four-arm.sumocfg' does not exist" in entry["failed"]
    assert not place.done(run("all-way-stop"))


def test_a_run_whose_lights_could_not_be_tuned_is_on_record(tmp_path: Path) -> None:
    place = Place(tmp_path, SETTINGS)
    fixed = run("fixed")
    assert schedule._spoiled(fixed, place, {needed(fixed, named("fixed")): "SUMO is not at home"})
    (entry,) = gather(tmp_path, SETTINGS)
    assert entry["failed"] == "its lights could not be tuned: SUMO is not at home"
    assert not schedule._spoiled(run("all-way-stop"), place, {})


def test_a_manager_that_does_not_serve_is_a_failed_run(tmp_path: Path) -> None:
    with pytest.raises(ProcessError, match=r"/nowhere\.toml: No such file"):
        Processes().two(["--config", "/nowhere.toml"], [], tmp_path)


def test_a_manager_that_is_killed_is_a_failed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def kill(process: subprocess.Popen[str]) -> None:
        process.kill()
        process.wait()

    monkeypatch.setattr(processes, "_end", kill)
    with pytest.raises(ProcessError, match="the manager ended with exit code -9: "):
        Processes().two(["--clock", "lockstep"], ["--help"], tmp_path)


def test_every_method_drives_the_same_arrivals(tmp_path: Path) -> None:
    place = Place(tmp_path, SETTINGS)
    assert place.scenario(run("coop", seed=101)) == place.scenario(run("fixed", seed=101))
    assert place.scenario(run("coop", seed=101)) != place.scenario(run("coop", seed=102))
    place.make_scenario(run("coop"))
    written = place.scenario(run()).with_name("four-arm.rou.xml")
    before = written.stat().st_mtime_ns
    place.make_scenario(run("fixed"))
    assert written.stat().st_mtime_ns == before


def test_probes_and_trucks_have_arrivals_of_their_own(tmp_path: Path) -> None:
    place = Place(tmp_path, SETTINGS)
    probes = [run(knob="aggressiveness", value=value) for value in (0.0, 1.0)]
    assert place.scenario(probes[0]) == place.scenario(probes[1]), "the same vehicles, with other wishes"
    place.make_scenario(probes[0])
    demand = place.scenario(probes[0]).with_name("four-arm.rou.xml").read_text()
    assert f'<vehicle id="{PROBE}.0"' in demand
    assert place.scenario(run(knob="trucks", value=0.2)) != place.scenario(run(knob="trucks", value=0.4))
    assert place.scenario(run(knob="lambda", value=0.2)) == place.scenario(run())


def test_plans_are_kept_by_demand(tmp_path: Path) -> None:
    fixed = plan_file(tmp_path, needed(run("fixed", 5200.0, 4.0), named("fixed")))
    assert fixed == tmp_path / "plans" / "fixed-5200-ratio4" / "plan.json"
    fixed.parent.mkdir(parents=True)
    write_plan(Plan(method="fixed", cycle_s=170.0, splits=(0.5, 0.5), left="permissive"), fixed)
    assert at_bounds(tmp_path) == ["`fixed-5200-ratio4`: cycle_s 170, the largest tried"]


def test_stopping_ends_what_runs_and_starts_nothing_more(tmp_path: Path) -> None:
    done: list[str] = []

    def first(processes: Processes) -> None:
        done.append("first")
        os.kill(os.getpid(), signal.SIGINT)
        try:
            processes.run(FOREVER, tmp_path / "log")
        except Stopped:
            done.append("stopped")
            raise

    def second(_processes: Processes) -> None:
        done.append("second")

    both = Processes(apart=True)
    with pytest.raises(KeyboardInterrupt), schedule.interruptible(both):
        schedule._together("runs", [(1.0, first), (1.0, second)], 1, both, QUIET)
    assert done == ["first", "stopped"]


def test_an_interrupted_run_is_no_result(tmp_path: Path) -> None:
    stopped = Processes()
    stopped.stop()
    with pytest.raises(Stopped):
        perform(run("all-way-stop"), Place(tmp_path, SETTINGS), stopped)
    assert gather(tmp_path, SETTINGS) == []


def test_the_record_of_a_failure_goes_when_the_run_is_tried_again(tmp_path: Path) -> None:
    folder = put(tmp_path, run("all-way-stop"), failed="bad luck")
    place = Place(tmp_path, SETTINGS)
    place.make_scenario(run("all-way-stop"))
    assert schedule.carry_out(place, [run("all-way-stop")], 1, Processes(), QUIET) == 1
    (entry,) = gather(tmp_path, SETTINGS)
    assert entry["failed"] is None
    assert entry["duration_s"] == SETTINGS.duration_s
    assert entry["machine"] == {"processor": machine().processor, "cores": cores(), "jobs": 1}
    assert json.loads((folder / "report.json").read_text())["method"] == "all-way-stop"


def test_a_failed_computation_is_the_fault_of_who_asked_for_it(tmp_path: Path) -> None:
    (tmp_path / "computation").mkdir()
    (tmp_path / "computation" / "failed.json").write_text('{"bench.json": "no cores left"}')
    place = Place(tmp_path, SETTINGS)
    assert command._conclude(place, [], 0, computation_asked=True) == command.EXIT_FAILED
    assert command._conclude(place, [], 0, computation_asked=False) == 0
    assert "- computation, bench.json: no cores left" in (tmp_path / "report.md").read_text()


def test_a_command_is_on_record_before_anything_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for words in (["compare", "--flows", "2000"], ["compare", "--flows", "4000"], ["compare", "--flows", "2000"]):
        monkeypatch.setattr("sys.argv", ["/somewhere/gameopt-sumo", *words])
        command._note_command(tmp_path)
    assert command._commands(tmp_path) == [f"gameopt-sumo compare --flows {flow}" for flow in (2000, 4000)]
