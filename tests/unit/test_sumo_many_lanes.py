"""The junction that growth is measured on is one that the map reader takes for what it is meant to be."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from many_lanes import write_net

from gameopt_sumo.network import read_map


def test_a_quarter_of_its_lanes_turns_each_way_and_nobody_merges(tmp_path: Path) -> None:
    net = tmp_path / "net.xml"
    write_net(net, lanes=4)
    junction = read_map(net, None)
    assert len(junction.lanes) == len(junction.movements) == 16
    assert Counter(movement.intention for movement in junction.movements) == {"right": 4, "straight": 8, "left": 4}
    assert len({movement.exit_lane for movement in junction.movements}) == 16
    assert not any(area.merge for area in junction.areas)
    assert {lane.zone_m for lane in junction.lanes} == {150.0}
    straight = {k for k, movement in enumerate(junction.movements) if movement.intention == "straight"}
    crossing = sum({area.a, area.b} <= straight for area in junction.areas)
    assert crossing == 4 * 2 * 2  # two arms cross two others, with two lanes each
