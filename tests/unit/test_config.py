"""The configuration file: what is read, and the one line that is written when it cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gameopt_im import config
from gameopt_im.core.parameters import Parameters

PAGE = Path(__file__).parents[2] / "docs" / "configuration.md"


def refusal(text: str) -> str:
    with pytest.raises(config.ConfigError) as caught:
        config.parse(text, "im.toml")
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_without_a_file_the_defaults_hold() -> None:
    assert config.load(None) == Parameters()


def test_an_empty_file_is_the_defaults() -> None:
    assert config.parse("") == Parameters()


def test_the_defaults_on_the_reference_page_are_the_defaults() -> None:
    heads_and_rows = re.findall(r"^## `(\[\w+\])`$|^\| `(\w+)` \| [^|]* \| `([^`]*)`", PAGE.read_text(), re.M)
    lines = [head or f"{key} = {default}" for head, key, default in heads_and_rows]
    text = "\n".join(lines[: lines.index("assertiveness = [1.0, 5.0]")])
    assert len(text.splitlines()) > 35
    assert config.parse(text) == Parameters()


def test_a_key_is_taken_from_the_file(tmp_path: Path) -> None:
    file = tmp_path / "im.toml"
    file.write_text("[program]\nlambda = 0.5\n[service]\ncollect_s = 0.03\n")
    parameters = config.load(file)
    assert parameters.program.lambda_ == 0.5
    assert parameters.service.collect_s == 0.03
    assert parameters.planner == Parameters().planner


def test_a_class_changes_only_the_keys_it_names() -> None:
    classes = config.parse("[classes.emergency]\nspeed_priority = [5, 9]\n").classes
    assert classes["emergency"].speed_priority == (5.0, 9.0)
    assert classes["emergency"].assertiveness == Parameters().classes["emergency"].assertiveness
    assert classes["truck"] == Parameters().classes["truck"]


def test_a_new_class_starts_from_passenger() -> None:
    classes = config.parse(
        "[classes.passenger]\nassertiveness = [2, 4]\n[classes.taxi]\nspeed_priority = [1, 2]\n"
    ).classes
    assert classes["taxi"].assertiveness == (2.0, 4.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[planner]\nmargin_s = 99\n",
            "im.toml: planner.margin_s: allowed: a number >= 0 and <= 60, in s; given: 99",
        ),
        (
            "[planner]\nmargin_s = 'x'\n",
            "im.toml: planner.margin_s: allowed: a number >= 0 and <= 60, in s; given: 'x'",
        ),
        ("[planner]\nmargin_s = nan\n", "im.toml: planner.margin_s: nan is not a finite number"),
        ("[auction]\nweights = [[1, inf, 0, 0]]\n", "im.toml: auction.weights[0][1]: inf is not a finite"),
        (
            "[exit]\nway = 1\n",
            "im.toml: exit.way: unknown key; allowed here: headway_s, distance_m, decel_mps2",
        ),
        (
            "[exits]\n",
            "im.toml: exits: unknown key; allowed here: auction, planner, program, interlock, exit",
        ),
        ("planner = 3\n", "im.toml: planner: allowed: incumbent, selection"),
        (
            "[auction]\nweights = [[1, 2]]\n",
            "im.toml: auction.weights[0]: allowed: a list of 1 to 64, each a",
        ),
        ("[program]\nlateral_rows = 'some'\n", 'im.toml: program.lateral_rows: allowed: "reduced" or "full"'),
        (
            "[classes.bus]\nassertiveness = [1]\n",
            "im.toml: classes.bus.assertiveness: allowed: a list of 2, each a number; given: [1]",
        ),
        (
            "[classes.bus]\nspeed = 1\n",
            "im.toml: classes.bus.speed: unknown key; allowed here: assertiveness",
        ),
        ("[classes]\nbus = 1\n", "im.toml: classes.bus: allowed: assertiveness, speed_priority"),
        ("classes = 1\n", "im.toml: classes: allowed: one table a vehicle class"),
        ("[planner\n", "im.toml: not TOML: "),
    ],
)
def test_a_bad_file_is_one_line_with_file_key_and_what_is_allowed(text: str, message: str) -> None:
    assert refusal(text).startswith(message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[planner]\nmargin_s = 0.1\n", "planner.margin_s: allowed: >= interlock.margin_s = 0.15 s"),
        ("[interlock]\nmargin_s = 0.3\n", "planner.margin_s: allowed: >= interlock.margin_s = 0.3 s"),
        ("[service]\nstale_s = 31\n", "service.stale_s: allowed: at most service.hold_s = 30 s"),
        ("[planner]\ndecels_mps2 = []\n", "planner.decels_mps2: allowed: one or more"),
        ("[planner]\ndecels_mps2 = [2, 1]\n", "planner.decels_mps2: allowed: one or more"),
        ("[auction]\nweights = [[0, 0, 0, 0]]\n", "auction.weights[0]: allowed: four numbers >= 0"),
        ("[auction]\nweights = [[1, 0, 0, -1]]\n", "auction.weights[0]: allowed: four numbers >= 0"),
        ("[classes.bus]\nassertiveness = [5, 4]\n", "classes.bus.assertiveness: allowed: [low, high] with"),
        ("[classes.bus]\nassertiveness = [5, 11]\n", "classes.bus.assertiveness: allowed: [low, high] with"),
        ("[classes.bus]\nspeed_priority = [0, 1]\n", "classes.bus.speed_priority: allowed: two numbers > 0"),
    ],
)
def test_keys_that_contradict_each_other_are_refused(text: str, message: str) -> None:
    assert refusal(text).startswith(f"im.toml: {message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[auction]\norder = 'arrival'\n",
            'planner.incumbent: allowed with auction.order = "arrival": false',
        ),
        (
            "[planner]\nupstream = false\n",
            "program.solve: allowed with planner.upstream = false: false",
        ),
        (
            "[planner]\nselection = 'objective'\n[program]\nsolve = false\n",
            'planner.selection: allowed with program.solve = false: "delay"',
        ),
        (
            "[interlock]\nask = 'standing'\n",
            'auction.order: allowed with interlock.ask = "standing": "arrival"',
        ),
        (
            "[interlock]\nask = 'standing'\n[auction]\norder = 'arrival'\n[planner]\nincumbent = false\n",
            'planner.upstream: allowed with interlock.ask = "standing": false',
        ),
        ("[interlock]\nask = 'now'\n", 'interlock.ask: allowed: "slot" or "rule" or "standing"; given: \'now\''),
        ("[planner]\nincumbent = 1\n", "planner.incumbent: allowed: true or false; given: 1"),
    ],
)
def test_switches_that_make_no_sense_together_are_refused(text: str, message: str) -> None:
    assert refusal(text) == f"im.toml: {message}"


def test_the_paper_has_no_switches() -> None:
    config.check_profile(Parameters(), "paper")
    first_come = config.parse("[auction]\norder = 'arrival'\n[planner]\nincumbent = false\n")
    config.check_profile(first_come, "default")
    with pytest.raises(config.ConfigError, match=r'^im\.toml: auction\.order: allowed under --profile paper: "dis'):
        config.check_profile(first_come, "paper", "im.toml")


def test_margins_exactly_their_distance_apart_are_accepted() -> None:
    text = "[planner]\nmargin_s = 0.4\n[interlock]\nmargin_s = 0.3\n"
    assert config.parse(text).planner.margin_s == 0.4


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(config.ConfigError, match=r"missing\.toml: No such file or directory$"):
        config.load(tmp_path / "missing.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe")
    with pytest.raises(config.ConfigError, match=r"binary\.toml: not UTF-8"):
        config.load(binary)


def test_the_reference_page_is_what_the_annotations_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == config.reference(), (
        "run: python -m gameopt_im.reference > docs/configuration.md"
    )


def test_every_key_has_a_description() -> None:
    rows = [line for line in config.reference().splitlines() if line.startswith("| `")]
    assert len(rows) > 40
    assert all(row.split("|")[-2].strip() for row in rows)
