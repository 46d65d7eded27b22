"""The gateway on a running SUMO: speeds executed exactly, poses on the map, both counts of collisions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sumo
import sumo_runs

from gameopt_sumo.scenarios import FourArm, write_four_arm

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_four_arm(FourArm(flow_veh_h=4000.0, seed=101, duration_s=200.0), tmp_path_factory.mktemp("busy"))


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_four_arm(FourArm(flow_veh_h=150.0, seed=5, duration_s=600.0), tmp_path_factory.mktemp("quiet"))


def test_a_set_speed_is_executed_exactly(run: Run, busy: Path) -> None:
    found = run(sumo_runs.set_speeds, busy)
    assert found["checked"] > 5_000
    assert found["stretches"] == ["approach", "exit", "in"]
    assert found["off_speed"] < 1e-9
    assert found["off_way"] < 1e-9


def test_sumo_poses_a_vehicle_on_the_chord_that_the_map_swept(run: Run, busy: Path) -> None:
    found = run(sumo_runs.poses_on_the_map, busy, busy.with_name("four-arm.net.xml"))
    assert found["checked"] > 1000
    assert found["off_m"] < 0.05
    assert found["off_deg"] < 0.5


def test_both_counts_see_the_collisions_when_nobody_yields(run: Run, busy: Path) -> None:
    safety = run(sumo_runs.nobody_yields, busy, 1500, 20.0)["safety"]
    assert safety["collisions_sumo"] > 5
    assert safety["collisions_geometric"] > 5
    assert safety["min_pet_s"] == 0.0
    assert safety["teleports"] == 0


def test_the_same_seed_gives_the_same_run(run: Run, quiet: Path) -> None:
    first = run(sumo_runs.nobody_yields, quiet, 1500, 0.0)
    assert first == run(sumo_runs.nobody_yields, quiet, 1500, 0.0)


def test_free_flow_takes_the_time_it_should(run: Run, quiet: Path) -> None:
    """At 25/50/25 about 9.7 s; each vehicle its own free flow."""
    found = run(sumo_runs.nobody_yields, quiet, 6000, 30.0)
    assert found["vehicles"]["arrived"] - found["vehicles"]["crossed"] - found["vehicles"]["in_zone"] == 0
    assert 9.4 <= found["time_to_goal_s"]["mean"] <= 10.1
    assert abs(found["time_loss_s"]["mean"]) < 0.05
    assert found["time_loss_s"]["max"] < 0.1


def test_only_watching_leaves_the_driving_to_sumo(run: Run, quiet: Path) -> None:
    found = run(sumo_runs.sumo_drives, quiet, 3000)
    assert found["controlled"] == 0
    assert found["safety"]["collisions_sumo"] == found["safety"]["collisions_geometric"] == 0
    assert found["vehicles"]["crossed"] > 5


def test_release_outputs_and_close(run: Run, quiet: Path, tmp_path: Path) -> None:
    found = run(sumo_runs.release_and_close, quiet, tmp_path / "fcd.xml")
    assert "is not under control" in found["refused"]
    assert found["furthest_m"] >= -285.0
    assert found["time_s"] == pytest.approx(150.0)  # the step length is enforced
    assert found["fcd"] > 1000


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.sumocfg", None, "no such file"),
        ("broken.sumocfg", "<configuration", "not a SUMO configuration"),
        ("empty.sumocfg", "<configuration/>", "names no net"),
        (
            "no-net.sumocfg",
            '<configuration><net-file value="gone.net.xml"/></configuration>',
            "gone.net.xml: no such",
        ),
    ],
)
def test_a_bad_configuration_is_one_line(tmp_path: Path, name: str, content: str | None, message: str) -> None:
    config = tmp_path / name
    if content is not None:
        config.write_text(content)
    said = sumo_runs.fails(config)
    assert message in said
    assert str(config) in said
    assert len(said.splitlines()) == 1


def test_what_sumo_refuses_is_one_line(
    run: Run, quiet: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    assert "no junction 'x'; candidates: junction" in run(sumo_runs.fails, quiet, "x")
    assert "No option with the name 'nope'" in run(sumo_runs.fails, quiet, None, ("--nope", "1"))
    fixed = run(sumo_runs.fails, quiet, None, ("--step-length=0.5",))
    assert fixed == "SUMO option --step-length is fixed to 0.1 here; leave it out"
    assert "--gui: there is no display" in run(sumo_runs.fails, quiet, None, (), True)
    assert capfd.readouterr().err == ""


def test_the_geometric_check_is_cheap(run: Run, busy: Path) -> None:
    assert run(sumo_runs.check_costs, busy) < 3.0


def test_a_vehicle_is_given_back_before_a_junction_where_it_has_to_yield(run: Run) -> None:
    """In SUMO's grid6 there are lights 66 m after the exit: nobody may come to them as if they were not there."""
    game = Path(sumo.SUMO_HOME, "tools", "game")
    found = run(sumo_runs.last_seen, game / "grid6.sumocfg", game / "grid6" / "grid6.net.xml", "1/0", 900)
    assert found["gone"] > 3
    assert found["controlled"] == []


def test_sumo_looks_for_no_other_route_for_those_who_are_taken_over(run: Run, quiet: Path) -> None:
    assert run(sumo_runs.rerouting_periods, quiet, "7") == {"controlled": ["0.00"], "others": ["7.00"]}


def test_a_vehicle_too_large_for_the_map_is_one_line(run: Run) -> None:
    """SUMO's game has buses of 12.5 m and trucks with trailers there."""
    said = run(sumo_runs.too_large, Path(sumo.SUMO_HOME, "tools", "game", "cross.sumocfg"), "0")
    assert "allowed at '0': up to 12 m by 2.55 m; up to 18.75 m by 2.6 m with --articulated on both sides" in said
    assert "\n" not in said
