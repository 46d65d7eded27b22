"""A junction that others cross, who neither bid nor obey, is refused in one line; exit code 2."""

from __future__ import annotations

from pathlib import Path

import plain_nets
import pytest

from gameopt_sumo import cli
from gameopt_sumo.network import NetworkError, read_map
from gameopt_sumo.scenarios import build_net


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


def test_an_exit_too_short_to_stand_clear_in_is_refused(tmp_path: Path) -> None:
    """Vehicles wait at its end for the next junction; 20.6 m hold a bus, and no longer vehicle."""
    net = plain_nets.build_plain("near-junction", tmp_path)
    assert read_map(net, plain_nets.CENTRE).intersection == plain_nets.CENTRE
    with pytest.raises(NetworkError) as caught:
        read_map(net, plain_nets.CENTRE, articulated=True)
    assert str(caught.value).startswith(f"{net}: junction 'centre': exit 'near_out' is 20.6 m long; ")
    assert "\n" not in str(caught.value)


def test_one_that_leaves_the_net_may_be_as_short_as_it_likes(tmp_path: Path) -> None:
    nodes, edges = ((plain_nets.PLAIN / f"single-lane.{kind}.xml").read_text() for kind in ("nod", "edg"))
    described = {"node": nodes.replace('x="350"', 'x="25"'), "edge": edges}
    net = tmp_path / "cut.net.xml"
    build_net(described, net, ("--no-turnarounds", "true"))
    assert min(movement.exit_length_m for movement in read_map(net).movements) == pytest.approx(11.8)
