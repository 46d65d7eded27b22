"""What is damaged, or cannot be written, is named in one line; nothing is ever left half-written."""

from __future__ import annotations

from pathlib import Path

import pytest
from compared import SETTINGS, put, report, run

from gameopt_sumo.cli import main
from gameopt_sumo.compare.computation import FOLDER
from gameopt_sumo.compare.settings import claim
from gameopt_sumo.files import FileError, read_json, write_whole

FULL = Path("/dev/full")
"""A disk without room."""
full_disk = pytest.mark.skipif(not FULL.exists(), reason="only Linux has /dev/full")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder in which the run asked for is whole, another has failed, and decisions were measured."""
    claim(tmp_path, SETTINGS)
    put(tmp_path, run("coop"), report())
    put(tmp_path, run("stop-sign"), failed="bad luck")
    (tmp_path / FOLDER).mkdir()
    return tmp_path


def compare(monkeypatch: pytest.MonkeyPatch, out: Path) -> object:
    """The exit code of the command that has nothing left to run."""
    arguments = ["--methods", "coop", "--flows", "10000", "--seeds", "1", "--tuning-budget", "4"]
    times = ["--duration", "40", "--warmup", "10"]
    monkeypatch.setattr("sys.argv", ["gameopt-sumo", "compare", *arguments, *times, "--out", str(out)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


@pytest.mark.parametrize(
    "damaged",
    [
        "runs/coop-10000-ratio1-seed101/run.json",
        "runs/coop-10000-ratio1-seed101/manager.json",
        "runs/coop-10000-ratio1-seed101/machine.json",
        "runs/stop-sign-10000-ratio1-seed101/failed.json",
        "computation/bench.json",
        "computation/optimal.json",
        "computation/machine.json",
        "computation/failed.json",
        "plans/fixed-10000-ratio1/plan.json",
        "settings.json",
    ],
)
@pytest.mark.parametrize("content", [b'{"measured":[{"veh', b"[1]"])
def test_a_damaged_file_is_named_in_one_line(
    out: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], damaged: str, content: bytes
) -> None:
    file = out / damaged
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    assert compare(monkeypatch, out) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"gameopt-sumo: {file}: ")
    assert said.count("\n") == 1


@full_disk
def test_a_full_disk_is_one_line(out: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    (out / "results.json.part").symlink_to(FULL)
    assert compare(monkeypatch, out) == 2
    assert capfd.readouterr().err == f"gameopt-sumo: {out / 'results.json'}: cannot write: No space left on device\n"


def test_a_lock_that_cannot_be_written_is_one_line(
    out: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (out / ".lock").mkdir()
    assert compare(monkeypatch, out) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"gameopt-sumo: {out / '.lock'}: ")
    assert said.count("\n") == 1


@full_disk
def test_a_file_is_there_whole_or_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    write_whole(file, b"1")
    (tmp_path / "plan.json.part").symlink_to(FULL)
    with pytest.raises(FileError, match=r"plan\.json: cannot write: No space left"):
        write_whole(file, b"2")
    assert read_json(file, int) == 1
