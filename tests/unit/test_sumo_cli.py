"""gameopt-sumo on the command line: what it writes, and one line and exit code 2 for bad input."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gameopt_sumo.cli import main
from gameopt_sumo.network import packaged_map
from gameopt_sumo.run_files import nominal_demand
from gameopt_wire.intersection import IntersectionMap


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    """Exit code of one call."""
    monkeypatch.setattr("sys.argv", ["gameopt-sumo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_scenario_then_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "s"
    flows = ["--arm-flows", "900,600,300,300", "--turns", ".2,.6,.2", "--classes", "car=1"]
    assert run(monkeypatch, "scenario", "four-arm", *flows, "--duration", "60", "--out", str(out)) == 0
    assert capfd.readouterr().out.strip() == str(out / "four-arm.sumocfg")

    net = str(out / "four-arm.net.xml")
    assert run(monkeypatch, "map", net, "--out", str(tmp_path / "map.json")) == 0
    written = (tmp_path / "map.json").read_bytes()
    assert msgspec.json.decode(written, type=IntersectionMap).digest() == packaged_map().digest()
    capfd.readouterr()
    assert run(monkeypatch, "map", net, "--junction", "junction") == 0
    assert capfd.readouterr().out.encode() == written


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing command"),
        (["fly"], "No such command 'fly'"),
        (["scenario", "four-arm", "--flow", "many"], "--flow"),
        (["scenario", "four-arm", "--flow", "-5"], "allowed: above 0 up to 40000"),
        (["scenario", "four-arm", "--turns", ".5,.5"], "--turns"),
        (["scenario", "four-arm", "--turns", ".5,.5,.5"], "add up to 1"),
        (["scenario", "four-arm", "--arm-flows", "1,2,3"], "--arm-flows"),
        (["scenario", "four-arm", "--classes", "car"], "--classes"),
        (["scenario", "four-arm", "--lanes", "9"], "allowed: 1, 2, 3"),
        (["scenario", "four-arm", "--duration", "1", "--out", "/dev/null/x"], "/dev/null/x"),
        (["map"], "Missing argument"),
        (["map", "/nowhere.net.xml"], "/nowhere.net.xml: no such file"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert run(monkeypatch, *arguments) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert message in said.err


@pytest.mark.parametrize("arguments", [["--help"], ["scenario", "four-arm", "--help"], ["map", "--help"]])
def test_help_names_units(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(monkeypatch, *arguments) == 0
    assert "Usage" in capfd.readouterr().out


def test_a_scenario_knows_its_demand_and_a_foreign_one_is_not_guessed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = ["--duration", "1", "--out", str(tmp_path)]
    config, demand = tmp_path / "four-arm.sumocfg", tmp_path / "four-arm.rou.xml"
    for flows, expected in (
        (["--flow", "4000", "--ratio", "3"], (4000.0, 3.0)),
        (["--arm-flows", "900,600,300,200"], (2000.0, 3.0)),
        (["--arm-flows", "900,600,0,0"], (1500.0, None)),
    ):
        assert run(monkeypatch, "scenario", "four-arm", *flows, *short) == 0
        assert nominal_demand(config, ()) == expected
    for own in (["--scale", "2"], ["-r", "other.rou.xml"], ["--route-files=other.rou.xml"]):
        assert nominal_demand(config, own) == (None, None)
    for foreign in (
        "<routes/>",
        '<?other flow_veh_h="1"?><routes/>',
        '<?gameopt flow_veh_h="-."?><routes/>',
        "<",
    ):
        demand.write_text(foreign)
        assert nominal_demand(config, ()) == (None, None)
    demand.unlink()
    assert nominal_demand(config, ()) == (None, None)
