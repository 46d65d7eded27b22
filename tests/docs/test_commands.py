"""The commands of the documentation: pages that lead somewhere are followed, all others are understood.

They are followed word by word, but for the other machine's address and, where it says so, for how long they run.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import takewhile
from pathlib import Path

import click
import pytest

from gameopt_im.cli import commands as im
from gameopt_sumo.cli import command as sumo
from gameopt_vehicles.cli import command as vehicles

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "deploy"))

from two_junctions import write_scenario  # noqa: E402 - a script, in no package

PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md")])
PATIENCE_S = 120.0
PROGRAMS: dict[str, click.Command] = {"gameopt-im": im, "gameopt-sumo": sumo, "gameopt-vehicles": vehicles}
NEEDS_DOCKER = {"docs/containers.md"}
"""Pages that say so; their commands are not run here."""
FOLLOWED = ("README.md", "docs/scale.md", "docs/tutorial.md", "docs/two-machines.md", "docs/results/loss.md")
"""Pages whose `sh` blocks are run as they stand."""
RUN_ELSEWHERE = {"make demo": "test_demo.py", "make two-junctions": "test_two_junctions.py"}
"""By tests of `tests/scenarios`."""
TAKE_LONG = {"make compare", "make load", "docs/results/comparison.md", "docs/results/comparison-turning.md"}
"""Minutes to hours: targets that no run of the tests waits for, and pages that say how they were made."""


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page that are marked so."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [block for marked, block in fenced if marked == language]


def lines(page: Path) -> list[str]:
    """What is to be typed by a page: the lines of its `sh` and unmarked blocks."""
    fenced = "".join((*blocks(page, ""), *blocks(page, "sh"))).replace("\\\n", " ")
    return [line.strip() for line in fenced.splitlines()]


def mentions(page: Path) -> list[str]:
    """What a page names between backquotes."""
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", page.read_text())


def of_ours(found: list[str]) -> list[str]:
    """Those that begin with one of our programs, or with one that runs them."""
    return [words for words in found if Path(words.split(" ", 1)[0]).name in (*PROGRAMS, "make", "docker")]


def is_a_usage(words: str) -> bool:
    """Whether it shows what may be given, not what to type."""
    return bool(re.search(r"[\[\]|…]|\b(DIR|N|FILE|VEH_H|ID|D|S|M|P|FACTOR)\b", words))


TYPED = [(str(page.relative_to(ROOT)), words) for page in PAGES for words in of_ours(lines(page))]
NAMED = [(str(page.relative_to(ROOT)), words) for page in PAGES for words in of_ours(mentions(page))]


@pytest.mark.parametrize(("page", "words"), TYPED, ids=[f"{page}: {words}" for page, words in TYPED])
def test_what_is_to_be_typed_is_understood(
    page: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, *given = shlex.split(words, comments=True)
    if program == "docker":
        assert page in NEEDS_DOCKER
    elif program == "make":
        asked = subprocess.run(["make", "--dry-run", *given], cwd=ROOT, capture_output=True, text=True, check=False)
        assert asked.returncode == 0, asked.stderr
    elif given and not is_a_usage(words):
        monkeypatch.chdir(tmp_path)
        for word in given:
            if re.fullmatch(r"[\w./-]+\.(xml|sumocfg|json5?|toml|mcap)", word):
                Path(word).parent.mkdir(parents=True, exist_ok=True)
                Path(word).touch()
        command, rest = meant(PROGRAMS[Path(program).name], given)
        command.make_context(command.name, rest)


@pytest.mark.parametrize(("page", "words"), TYPED, ids=[f"{page}: {words}" for page, words in TYPED])
def test_what_is_to_be_typed_is_run_or_it_is_known_why_not(page: str, words: str) -> None:
    command = words.partition("#")[0].strip()
    if command in RUN_ELSEWHERE:
        there = (ROOT / "tests/scenarios" / RUN_ELSEWHERE[command]).read_text()
        assert f"deploy/{command.removeprefix('make ').replace('-', '_')}.py" in (ROOT / "Makefile").read_text()
        assert "subprocess.run" in there
        return
    followed = page in FOLLOWED and any(words in block for block in blocks(ROOT / page, "sh"))
    known = is_a_usage(words) or bool({page, command} & (NEEDS_DOCKER | TAKE_LONG))
    assert followed != known, f"{page}: {words}"


@pytest.mark.parametrize(("page", "words"), NAMED, ids=[f"{page}: {words}" for page, words in NAMED])
def test_what_is_named_is_there(page: str, words: str) -> None:
    program, *given = words.split()
    if program == "make":
        makefile = (ROOT / "Makefile").read_text()
        assert all(f"\n{target}:" in makefile for target in given[:1]), page
    elif program in PROGRAMS:
        command, rest = meant(PROGRAMS[program], given)
        known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
        assert {word for word in rest if word.startswith("-")} <= known, page


def meant(command: click.Command, given: list[str]) -> tuple[click.Command, list[str]]:
    """The command behind a program's groups, and what it is given."""
    while isinstance(command, click.Group) and given and not given[0].startswith("-"):
        assert given[0] in command.commands, f"{given[0]}: {', '.join(command.commands)}"
        command, given = command.commands[given[0]], given[1:]
    return command, given


@contextmanager
def serving(block: str, folder: Path) -> Iterator[None]:
    """The manager of a block in the background, from the moment it serves."""
    with subprocess.Popen(shlex.split(block), cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        said = list(takewhile(lambda line: " serving " not in line, process.stderr))
        try:
            assert process.poll() is None, "".join(said)
            yield
        finally:
            process.terminate()
            process.communicate(timeout=PATIENCE_S)


def script(block: str, folder: Path) -> None:
    """Run a block as it stands."""
    done = subprocess.run(
        ["bash", "-c", f"set -e\n{block}"], cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    assert done.returncode == 0, block + done.stdout + done.stderr


def follow(page: Path, folder: Path, **instead: str) -> None:
    """Run the `sh` blocks of a page in their order; managers serve until the vehicles of the next block end."""
    managers: list[str] = []
    for written in blocks(page, "sh"):
        block = re.sub("|".join(map(re.escape, instead)) or "$^", lambda found: instead[found[0]], written)
        if "gameopt-im serve" in block:
            managers.append(block)
            continue
        with ExitStack() as ends:
            for manager in managers:
                ends.enter_context(serving(manager, folder))
            script(block, folder)
        managers.clear()


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after `. .venv/bin/activate`."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")


@pytest.mark.processes
def test_by_hand_it_runs_as_the_readme_says(tmp_path: Path) -> None:
    (tmp_path / ".venv").symlink_to(Path(sys.prefix))
    follow(ROOT / "README.md", tmp_path)
    assert (tmp_path / "out/report.json").exists()


@pytest.mark.processes
def test_two_managers_share_a_network(tmp_path: Path) -> None:
    folder = tmp_path / "out/two-junctions"
    folder.mkdir(parents=True)
    write_scenario(folder, 60.0, 1)
    follow(ROOT / "docs/scale.md", tmp_path)
    assert sorted(path.name for path in tmp_path.glob("*.json")) == ["report.east.json", "report.west.json"]


@pytest.mark.processes
def test_the_tutorial_leads_to_a_comparison(tmp_path: Path) -> None:
    shorter = {"--duration 120": "--duration 60", "--warmup 30": "--warmup 20"}
    follow(ROOT / "docs/tutorial.md", tmp_path, **shorter)
    assert "| coop |" in (tmp_path / "comparison/report.md").read_text()


@pytest.mark.processes
def test_manager_and_vehicles_meet_over_tcp_and_tls(tmp_path: Path) -> None:
    follow(ROOT / "docs/two-machines.md", tmp_path, **{"192.0.2.10": "127.0.0.1", "--duration 20": "--duration 10"})


@pytest.mark.processes
def test_vehicles_get_through_where_messages_are_lost(tmp_path: Path) -> None:
    follow(ROOT / "docs/results/loss.md", tmp_path, **{"--duration 300": "--duration 120"})
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["messages"]["lost"] > 2_000
    assert report["vehicles"]["crossed"] > 100
