"""The methods and ablations of the comparison: every file is a configuration of the one manager."""

from __future__ import annotations

from importlib import resources

import msgspec
import pytest

from gameopt_im import config
from gameopt_im.core.parameters import Parameters

FILES = {
    file.name.removesuffix(".toml"): file.read_text(encoding="utf-8")
    for file in (resources.files("gameopt_sumo") / "compare" / "methods").iterdir()
    if file.name.endswith(".toml")
}


def changed(name: str) -> set[str]:
    """The keys with which a method departs from the defaults."""
    usual, given = (msgspec.to_builtins(each) for each in (Parameters(), config.parse(FILES[name], name)))
    return {f"{table}.{key}" for table, keys in usual.items() for key in keys if given[table][key] != usual[table][key]}


def test_they_are_all_there() -> None:
    ablations = {
        "dispatch", "candidates", "incumbent", "selection", "programs", "clearing-ahead", "waiting-upstream",
        "transfers", "patience", "hold",
    }  # fmt: skip
    assert set(FILES) == {"coop-fifo", "coop-v1", "stop-sign"} | {f"ablation-{each}" for each in ablations}


@pytest.mark.parametrize("name", sorted(FILES))
def test_each_is_accepted_says_what_it_is_and_changes_what_it_names(name: str) -> None:
    first, *rest = FILES[name].splitlines()
    assert first.startswith("# Off: " if name.startswith("ablation") else "# ")
    written = {line.partition(" = ")[0] for line in rest if " = " in line}
    assert {key.partition(".")[2] for key in changed(name)} == written


def test_no_two_are_alike() -> None:
    assert len({frozenset(changed(name)) | {FILES[name]} for name in FILES}) == len(FILES)


def test_an_ablation_switches_one_idea_off() -> None:
    """Programs spread the waiting upstream, so they go with it; patience is a bid's and the selection's."""
    more = {name for name in FILES if name.startswith("ablation") and len(changed(name)) > 1}
    assert more == {"ablation-waiting-upstream", "ablation-patience"}
