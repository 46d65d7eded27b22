"""Lights and stop signs stand on the scenario's own ground, and plans become the phases they say."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from gameopt_sumo.baselines import nets
from gameopt_sumo.baselines.cli import main
from gameopt_sumo.baselines.lights import signals
from gameopt_sumo.baselines.plan import BaselineError, Left, Plan, Right
from gameopt_sumo.baselines.report import SCHEMA, Report
from gameopt_sumo.junction import read_net
from gameopt_sumo.network import read_map
from gameopt_sumo.run_files import net_file_of
from gameopt_sumo.scenarios import JUNCTION, FourArm, write_four_arm
from gameopt_vehicles import report as ours

FOUR = (0.3, 0.2, 0.3, 0.2)
LEFTS: dict[Left, tuple[float, ...]] = {"protected": FOUR, "both": FOUR, "permissive": (0.6, 0.4)}


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_four_arm(FourArm(flow_veh_h=2000.0, duration_s=60.0), tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def plain(config: Path) -> Path:
    return config.with_name("four-arm.net.xml")


def plan(left: Left = "protected", right: Right = "always", **given: object) -> Plan:
    values = {"method": "fixed", "cycle_s": 100.0, "splits": LEFTS[left], "left": left, "right": right, **given}
    return msgspec.convert(values, Plan)


def lit(plain: Path, folder: Path, wanted: Plan) -> Path:
    out = folder / "lit.net.xml"
    nets.lights(plain, None, wanted, out)
    return out


def phases(net: Path) -> list[ET.Element]:
    logic = ET.parse(net).getroot().findall("tlLogic")
    assert len(logic) == 1
    return logic[0].findall("phase")


def test_the_ground_is_the_same_under_lights_and_stop_signs(plain: Path, tmp_path: Path) -> None:
    before = read_map(plain)
    nets.all_way_stop(plain, None, tmp_path / "stop.net.xml")
    for net in (lit(plain, tmp_path, plan()), tmp_path / "stop.net.xml"):
        after = read_map(net)
        assert [lane.id for lane in after.lanes] == [lane.id for lane in before.lanes]
        assert [lane.zone_m for lane in after.lanes] == [lane.zone_m for lane in before.lanes]
        for old, new in zip(before.movements, after.movements, strict=True):
            assert (new.id, new.lane, new.exit_lane) == (old.id, old.lane, old.exit_lane)
            assert new.length_m == pytest.approx(old.length_m, abs=0.02)
            assert new.turn_speed_mps == old.turn_speed_mps
            assert new.exit_length_m == old.exit_length_m


def test_the_arrivals_find_their_lanes(config: Path, plain: Path, tmp_path: Path) -> None:
    net = read_net(lit(plain, tmp_path, plan()))
    demand = ET.parse(config.with_name("four-arm.rou.xml")).getroot()
    routes = {route.get("id"): str(route.get("edges")).split() for route in demand.iter("route")}
    vehicles = list(demand.iter("vehicle"))
    assert len(vehicles) > 20
    for vehicle in vehicles:
        here, onward = routes[vehicle.get("route")]
        lane = net.getLane(f"{here}_{vehicle.get('departLane')}")
        assert onward in {connection.getTo().getID() for connection in lane.getOutgoing()}


@pytest.mark.parametrize(("old", "new"), [('length="404.40"', 'length="404.50"'), ('speed="11.03"', 'speed="12.00"')])
def test_other_ground_is_refused(plain: Path, tmp_path: Path, old: str, new: str) -> None:
    changed = tmp_path / "changed.net.xml"
    changed.write_text(plain.read_text().replace(old, new))
    nets.same_ground(plain, plain, JUNCTION)
    with pytest.raises(BaselineError, match="netconvert changes"):
        nets.same_ground(plain, changed, JUNCTION)


@pytest.mark.parametrize("left", LEFTS)
@pytest.mark.parametrize("right", ["always", "with-straight"])
def test_no_two_who_cross_have_priority_together(plain: Path, tmp_path: Path, left: Left, right: Right) -> None:
    net_file = lit(plain, tmp_path, plan(left, right))
    net = read_net(net_file)
    shown = signals(net, net.getNode(JUNCTION))
    assert len(shown) == 12
    served = set()
    for phase in phases(net_file):
        state = str(phase.get("state"))
        served |= {k for k, letter in enumerate(state) if letter in "Gg"}
        for signal in shown:
            crossing = {state[foe] for foe in signal.foes}
            assert not (state[signal.index] == "G" and "G" in crossing)
            assert not (state[signal.index] == "g" and left == "protected")
    assert len(served) == 12


@pytest.mark.parametrize("left", LEFTS)
def test_who_loses_green_sees_yellow_and_then_all_wait(plain: Path, tmp_path: Path, left: Left) -> None:
    found = phases(lit(plain, tmp_path, plan(left)))
    assert sum(float(phase.get("duration", 0.0)) for phase in found) == pytest.approx(100.0, abs=0.3)
    states = [str(phase.get("state")) for phase in found]
    assert [phase.get("duration") for phase in found[1::3]] == ["4.0"] * len(LEFTS[left])
    assert [phase.get("duration") for phase in found[2::3]] == ["1.0"] * len(LEFTS[left])
    for now, then in pairwise([*states, states[0]]):
        for a, b in zip(now, then, strict=True):
            assert not (a in "Gg" and b == "r"), "red without yellow"
            assert not (a == "y" and b != "r"), "yellow is followed by red"


def test_the_cycle_is_split_as_the_plan_says(plain: Path, tmp_path: Path) -> None:
    greens = [phase.get("duration") for phase in phases(lit(plain, tmp_path, plan()))[::3]]
    assert greens == ["24.0", "16.0", "24.0", "16.0"]


def test_right_turns_have_green_all_the_time_if_the_plan_says_so(plain: Path, tmp_path: Path) -> None:
    def always(right: Right) -> int:
        states = [str(phase.get("state")) for phase in phases(lit(plain, tmp_path, plan(right=right)))]
        return sum(set(column) <= {"G", "g"} for column in zip(*states, strict=True))

    assert always("always") == 4
    assert always("with-straight") == 0


def test_actuated_lights_have_limits_and_do_not_count_free_right_turns(plain: Path, tmp_path: Path) -> None:
    net = lit(plain, tmp_path, plan(method="actuated", min_green_s=6.0, max_gap_s=2.5))
    logic = ET.parse(net).getroot().find("tlLogic")
    assert logic is not None
    assert logic.get("type") == "actuated"
    given = {param.get("key"): param.get("value") for param in logic.findall("param")}
    assert given.pop("max-gap") == "2.5"
    assert given.pop("detector-gap") == "2"
    assert given == {f"{arm}_in_0": "NO_DETECTOR" for arm in "ENSW"}
    limits = [(phase.get("minDur"), phase.get("maxDur")) for phase in phases(net)]
    assert limits[0] == ("6.0", "24.0")
    assert limits[1] == limits[2] == (None, None)


def test_a_shared_lane_has_no_protected_left(tmp_path: Path) -> None:
    one_lane = write_four_arm(FourArm(lanes=1, duration_s=60.0), tmp_path).with_name("four-arm.net.xml")
    with pytest.raises(BaselineError, match="lane E_in_0 is not for left turns alone"):
        lit(one_lane, tmp_path, plan())
    assert len(phases(lit(one_lane, tmp_path, plan("permissive")))) == 6


def test_lights_that_are_there_only_get_another_program(plain: Path, tmp_path: Path) -> None:
    once = lit(plain, tmp_path, plan())
    twice = tmp_path / "twice.net.xml"
    nets.lights(once, None, plan("permissive"), twice)
    assert len(phases(twice)) == 6
    nets.lights(twice, None, plan(), tmp_path / "thrice.net.xml")
    assert (tmp_path / "thrice.net.xml").read_text() == once.read_text()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cycle_s": 1}, "$.cycle_s"),
        ({"cycle_s": "long"}, "$.cycle_s"),
        ({"left": "never"}, "$.left"),
        ({"greens": [1]}, "unknown field `greens`"),
        ({"splits": [0.5, 0.5]}, "splits has 2 shares, 4 are needed: straight of roads 0 and 1, left of roads"),
        ({"splits": [0.3, 0.3, 0.3, 0.3]}, "splits must add up to 1"),
        ({"splits": [0.49, 0.02, 0.29, 0.2]}, "leaves 1.6 s of green to left of roads 0 and 1, allowed: 4 or more"),
        ({"method": "actuated"}, "method is 'actuated', allowed here: 'fixed'"),
    ],
)
def test_a_bad_plan_is_one_line_and_exit_2(
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    changes: dict[str, object],
    message: str,
) -> None:
    file = tmp_path / "plan.json"
    file.write_bytes(msgspec.json.encode({**msgspec.to_builtins(plan()), **changes}))
    run = ["run", str(config), "--method", "fixed", "--plan", str(file), "--report", str(tmp_path / "r.json")]
    assert _exit_code(monkeypatch, *run) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert f"{file}: " in said.err
    assert message in said.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "fixed"], "--plan is needed"),
        (["--method", "hope"], "--method"),
        (["--method", "all-way-stop", "--plan", "CONFIG"], "--plan is needed for --method fixed and actuated"),
        (["--method", "own", "--warmup", "300"], "--warmup 300 must be below --duration 300"),
        (["--method", "own", "--duration", "nan"], "not a finite number"),
        (["--method", "all-way-stop", "--junction", "nowhere"], "no junction 'nowhere'"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_2(
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    given = [str(config) if argument == "CONFIG" else argument for argument in arguments]
    assert _exit_code(monkeypatch, "run", str(config), *given, "--report", str(tmp_path / "r.json")) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert message in said


def test_the_report_has_the_fields_of_our_own() -> None:
    assert ours.SCHEMA == SCHEMA
    assert Report.__struct_fields__ == ours.Report.__struct_fields__
    mine = {field.name: field.type for field in msgspec.structs.fields(Report)}
    theirs = {field.name: field.type for field in msgspec.structs.fields(ours.Report)}
    for part in ("vehicles", "time_to_goal_s", "time_loss_s", "safety"):
        assert mine[part].__struct_fields__ == theirs[part].__struct_fields__
    (_, mine_class), (_, their_class) = mine["by_class"].__args__, theirs["by_class"].__args__
    assert mine_class.__struct_fields__ == their_class.__struct_fields__


@pytest.mark.parametrize(
    ("own", "named"),
    [
        ((), None),
        (("--net-file", "other.net.xml"), "other.net.xml"),
        (("-n=a.net.xml", "--scale", "2"), "a.net.xml"),
        (("--net", "a.net.xml", "--net-file", "b.net.xml"), "b.net.xml"),
    ],
)
def test_the_map_is_read_from_the_net_that_sumo_loads(config: Path, own: tuple[str, ...], named: str | None) -> None:
    assert net_file_of(config, own) == (Path(named) if named else config.with_name("four-arm.net.xml"))


def _exit_code(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    monkeypatch.setattr("sys.argv", ["gameopt_sumo.baselines", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code
