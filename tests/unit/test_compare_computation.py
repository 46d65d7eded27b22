"""Computation goes on where it was, and belongs to a folder of the settings it is measured with."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from compared import SETTINGS
from rich.console import Console

from gameopt_sumo.compare import computation
from gameopt_sumo.compare.computation import BENCH, OPTIMAL, measure, read
from gameopt_sumo.compare.processes import ProcessError, Processes, machine
from gameopt_sumo.compare.runs import MACHINE, Place
from gameopt_sumo.compare.settings import Settings, SettingsError

STATE = {
    "solved": True, "optimal_s": 0.4, "optimal": 2.0, "auction_s": 0.01, "auction": 3.0, "full_rows_s": 0.02
}  # fmt: skip


@pytest.mark.parametrize(("name", "left"), [(OPTIMAL, b"a size"), (BENCH, b"")])
def test_optima_that_are_there_are_gone_on_from(tmp_path: Path, name: str, left: bytes) -> None:
    (tmp_path / f"part-{name}").write_bytes(b"a size")

    def goes_on(_folder: Path, path: Path, _processes: Processes) -> int:
        before = path.read_bytes() if path.exists() else b""
        path.write_bytes(before + b" and another")
        return 0

    assert computation._step(goes_on, tmp_path, name, Processes()) is None
    assert (tmp_path / name).read_bytes() == left + b" and another"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([MACHINE, name])


def test_a_step_that_fails_says_why(tmp_path: Path) -> None:
    def fails(_folder: Path, _path: Path, _processes: Processes) -> int:
        raise ProcessError("no manager")

    assert computation._step(fails, tmp_path, BENCH, Processes()) == "no manager"
    assert not (tmp_path / BENCH).exists()


@pytest.mark.parametrize(
    ("different", "option"), [({"geometry": "box"}, "--geometry box"), ({"turn_speed": False}, "--ignore-turn-speed")]
)
def test_it_is_not_measured_for_other_settings(tmp_path: Path, different: dict[str, object], option: str) -> None:
    settings: Settings = msgspec.structs.replace(SETTINGS, **different)
    with pytest.raises(SettingsError, match=f"leave out {option}"):
        measure(Place(tmp_path, settings), Processes(), Console(quiet=True))
    assert list(tmp_path.iterdir()) == []


def test_the_optimum_says_why_it_ended(tmp_path: Path) -> None:
    folder = tmp_path / computation.FOLDER
    folder.mkdir()
    unsolved = {**STATE, "solved": False, "optimal": None, "optimal_s": 60.0}
    size = {"vehicles": 40, "states": [STATE, STATE, unsolved]}
    (folder / OPTIMAL).write_bytes(msgspec.json.encode({"sizes": [size], "ended": "1 of 3 not solved"}))
    (folder / MACHINE).write_bytes(msgspec.json.encode(machine()))
    found = read(tmp_path)
    assert found is not None
    assert (found.ended, found.machine) == ("1 of 3 not solved", machine())
    (joint,) = found.joint
    assert (joint.vehicles, joint.states, joint.proven) == (40, 3, pytest.approx(2 / 3))
    assert (joint.factor, joint.excess) == (pytest.approx(40.0), pytest.approx(0.5))
