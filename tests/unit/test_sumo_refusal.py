"""A junction that others cross, who neither bid nor obey, is refused in one line; exit code 2."""

from __future__ import annotations

from pathlib import Path

import plain_nets
import pytest

from gameopt_sumo import cli
from gameopt_sumo.network import NetworkError, read_map


@pytest.mark.parametrize(
    ("name", "options", "what"),
    [
        ("t-junction", ["--sidewalks.guess", "--crossings.guess"], "a pedestrian crossing (':centre_c0')"),
        ("railway", [], "a railway"),
    ],
)
def test_it_is_refused_in_one_line(tmp_path: Path, name: str, options: list[str], what: str) -> None:
    net = plain_nets.build_plain(name, tmp_path, *options)
    with pytest.raises(NetworkError) as caught:
        read_map(net, plain_nets.CENTRE)
    said = str(caught.value)
    assert f"{net}: junction 'centre': {what}" in said
    assert "only junctions that vehicles alone cross can be managed" in said
    assert "\n" not in said


def test_the_command_exits_with_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    net = plain_nets.build_plain("railway", tmp_path)
    monkeypatch.setattr("sys.argv", ["gameopt-sumo", "map", str(net), "--junction", plain_nets.CENTRE])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert "a railway" in said.err


def test_footpaths_that_cross_nothing_are_no_obstacle(tmp_path: Path) -> None:
    """Sidewalks along the arms, and nobody to walk over them."""
    net = plain_nets.build_plain("t-junction", tmp_path, "--sidewalks.guess")
    assert len(read_map(net).movements) == 8


@pytest.mark.parametrize("name", plain_nets.NAMES)
def test_where_vehicles_alone_cross_there_is_a_map(tmp_path: Path, name: str) -> None:
    found = read_map(plain_nets.build_plain(name, tmp_path))
    assert found.intersection == plain_nets.CENTRE
    assert found.areas
