"""A results folder belongs to the settings it was made with; methods and experiments by name."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gameopt_sumo.cli import main
from gameopt_sumo.compare.experiments import check_seeds, experiments, runs_of
from gameopt_sumo.compare.methods import MethodError, check_goes_with, known, named
from gameopt_sumo.compare.plans import needed
from gameopt_sumo.compare.settings import TUNING_SEEDS, Settings, SettingsError, alone, claim, digest
from gameopt_sumo.compare.sources import code_digest, folders, versions
from gameopt_sumo.scenarios import FourArm, write_four_arm


def settings(**different: Any) -> Settings:
    usual: dict[str, Any] = {"versions": versions(), "duration_s": 40.0, "warmup_s": 10.0, "tuning_budget": 4}
    return Settings(**(usual | different))


@pytest.mark.parametrize(
    ("different", "says"),
    [
        ({"duration_s": 50.0}, "duration_s 40.0, not 50.0"),
        ({"warmup_s": 20.0}, "warmup_s 10.0, not 20.0"),
        ({"geometry": "box"}, 'geometry "areas", not "box"'),
        ({"turn_speed": False}, "turn_speed true, not false"),
        ({"tuning_budget": 8}, "tuning_budget 4, not 8"),
        ({"report_schema": "gameopt-report/2"}, "report_schema"),
        ({"sumo": "/elsewhere.sumocfg", "sumo_digest": "0f"}, 'sumo_digest null, not "0f"'),
    ],
)
def test_a_folder_of_other_settings_is_refused_in_one_line(
    tmp_path: Path, different: dict[str, Any], says: str
) -> None:
    claim(tmp_path, settings())
    claim(tmp_path, settings())
    with pytest.raises(SettingsError, match="choose another --out") as refused:
        claim(tmp_path, settings(**different))
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_another_demand_is_another_scenario(tmp_path: Path) -> None:
    config = write_four_arm(FourArm(flow_veh_h=600.0, seed=1, duration_s=60.0), tmp_path)
    before = digest(config)
    assert digest(config) == before
    write_four_arm(FourArm(flow_veh_h=600.0, seed=2, duration_s=60.0), tmp_path)
    assert digest(config) != before


def test_a_folder_of_other_versions_is_refused(tmp_path: Path) -> None:
    claim(tmp_path, Settings(versions=versions() | {"libsumo": "0.1"}, duration_s=40, warmup_s=10, tuning_budget=4))
    with pytest.raises(SettingsError, match=r'versions\.libsumo "0\.1", not'):
        claim(tmp_path, settings())


def test_a_folder_of_other_code_is_refused(tmp_path: Path) -> None:
    (ours,) = (folder for folder in folders() if folder.name == "gameopt_sumo")
    copy = tmp_path / ours.name
    shutil.copytree(ours, copy, ignore=shutil.ignore_patterns("__pycache__"))

    def of_copy() -> Settings:
        return settings(versions=versions() | {"code": code_digest([copy])})

    claim(tmp_path / "out", of_copy())
    (copy / "compare" / "page.py").write_text("# the page reads runs, it shapes none\n")
    claim(tmp_path / "out", of_copy())
    method = copy / "compare" / "methods" / "ablation-hold.toml"
    method.write_bytes(method.read_bytes().replace(b"hold_weight = 0.0", b"hold_weight = 0.1"))
    with pytest.raises(SettingsError, match=r'versions\.code "[0-9a-f]{16}", not "[0-9a-f]{16}"; choose another'):
        claim(tmp_path / "out", of_copy())


def test_all_packages_are_digested_and_none_is_imported() -> None:
    assert {folder.name for folder in folders()} == {"gameopt_wire", "gameopt_im", "gameopt_vehicles", "gameopt_sumo"}
    code = (
        "import sys; from gameopt_sumo.compare.sources import versions; versions(); print('gameopt_im' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_what_one_experiment_needs_may_be_installed_later(tmp_path: Path) -> None:
    without = {name: version for name, version in versions().items() if name != "pyscipopt"}
    claim(tmp_path, settings(versions=without))
    claim(tmp_path, settings(versions=without | {"pyscipopt": "6.0"}))
    claim(tmp_path, settings(versions=without))
    with pytest.raises(SettingsError, match=r'versions\.pyscipopt "6\.0", not "5\.5"'):
        claim(tmp_path, settings(versions=without | {"pyscipopt": "5.5"}))


def test_a_scenario_may_be_moved(tmp_path: Path) -> None:
    claim(tmp_path, settings(sumo="/here/x.sumocfg", sumo_digest="0f"))
    claim(tmp_path, settings(sumo="/there/x.sumocfg", sumo_digest="0f"))


def test_results_of_unknown_settings_are_not_added_to(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("[]")
    with pytest.raises(SettingsError, match=r"has results\.json but no settings\.json"):
        claim(tmp_path, settings())


def test_one_comparison_at_a_time(tmp_path: Path) -> None:
    with alone(tmp_path), pytest.raises(SettingsError, match="another comparison"), alone(tmp_path):
        pass
    with alone(tmp_path):
        pass


def test_settings_are_claimed_by_who_is_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr(
        "sys.argv", ["gameopt-sumo", "compare", "--methods", "coop", "--flows", "2000", "--out", str(out)]
    )
    with alone(out), pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert not (out / "settings.json").exists()


def test_every_configuration_is_a_method_that_says_what_it_is() -> None:
    methods = known()
    assert {"coop", "coop-paper", "coop-fifo", "coop-v1", "fixed-held", "stop-sign", "own"} <= set(methods)
    assert all(len(method.about) > 10 for method in methods.values())
    assert methods["stop-sign"].geometry == methods["coop-paper"].geometry == "box"


def test_a_geometry_of_its_own() -> None:
    assert named("coop@box").geometry == "box"
    for wrong in ("coop@round", "fixed@box", "stop-sign@areas"):
        with pytest.raises(MethodError, match=wrong):
            named(wrong)


def test_held_lights_have_the_plan_of_balanced_inflow() -> None:
    (run,) = (run for run in runs_of(experiments()["unbalanced"], [named("fixed")], 1, False) if run.ratio == 4.0)
    assert needed(run, named("fixed")).ratio == 4.0
    assert needed(run, named("fixed-held")).ratio == 1.0


def test_seeds_begin_where_they_are_told_to() -> None:
    runs = runs_of(experiments()["drift"], [named("coop")], 2, False, first_seed=301)
    assert {run.seed for run in runs} == {301, 302}


def test_lights_are_not_measured_on_what_they_are_tuned_on() -> None:
    with pytest.raises(MethodError, match="fixed is tuned on seed 201"):
        check_seeds(199, 3, [named("coop"), named("fixed")])
    check_seeds(199, 2, [named("fixed")])
    check_seeds(TUNING_SEEDS[0], 1, [named("coop")])


def test_lights_that_need_tuning_are_refused_on_a_foreign_net() -> None:
    with pytest.raises(MethodError, match="fixed needs a generated scenario"):
        check_goes_with(named("fixed"), Path("x.sumocfg"))
    check_goes_with(named("own"), Path("x.sumocfg"))


def test_the_experiments_are_those_of_the_command() -> None:
    from gameopt_sumo.compare.command import EXPERIMENTS

    assert tuple(experiments()) == EXPERIMENTS
    for experiment in experiments().values():
        names = [run.name for run in runs_of(experiment, [named(name) for name in experiment.methods], 3, False)]
        assert len(names) == len(set(names))
        assert bool(names) != experiment.computation


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give --methods and --flows"),
        (["--methods", "coop"], "give --methods and --flows"),
        (["--methods", "magic", "--flows", "2000"], "'magic' is not a method; allowed: coop,"),
        (["--methods", "coop", "--flows", "-1"], "flow is -1 veh/h"),
        (["--methods", "coop", "--flows", "many"], "--flows"),
        (["--methods", "coop", "--flows", "nan"], "--flows"),
        (["--methods", "coop", "--flows", "2000", "--ratios", "0"], "ratio is 0"),
        (["--methods", "coop", "--flows", "2000", "--warmup", "360"], "--warmup 360 s must be less"),
        (["--methods", "coop", "--flows", "2000", "--junction", "x"], "--junction: allowed only with --sumo"),
        (["--methods", "coop", "--sumo", "/nowhere.sumocfg"], "/nowhere.sumocfg"),
        (["--experiment", "drift", "--methods", "fixed"], "fixed has no noise to vary"),
        (["--methods", "coop", "--flows", "2000", "--out", "/dev/null/x"], "/dev/null/x"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "out")]
    monkeypatch.setattr("sys.argv", ["gameopt-sumo", "compare", *arguments, *out])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capfd.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
