"""The comparison with the optimum, on a recording of made-up traffic: what it measures, and what it refuses."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import pytest

from gameopt_im import optimal
from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters
from gameopt_im.manager import Manager
from gameopt_im.optimal_results import Results, write
from gameopt_im.options import ServeOptions
from gameopt_im.recorder import Recorder
from gameopt_im.rehearsal import Rehearsal
from gameopt_im.service import charter_of, solver_of
from gameopt_sumo.network import packaged_map

OPTIONS = ServeOptions(map=packaged_map(), parameters=Parameters(), clock="lockstep", workers=0)


async def record(path: Path) -> None:
    """Two seconds of thirty vehicles that start from queues."""
    traffic = Rehearsal(OPTIONS.map, 30)
    with Recorder(path, charter_of(OPTIONS, 1), OPTIONS.parameters, ()) as recorder:
        async with solver_of(OPTIONS) as pool:
            manager = Manager(OPTIONS, 1, pool)
            for cycle in range(1, 20):
                messages = traffic.messages(cycle / 10)
                outcome = await manager.control_cycle(cycle, cycle / 10, messages)
                recorder.record(Tick(cycle, cycle / 10, messages, False), outcome.commands)
                traffic.obey(outcome.commands)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "thirty.mcap"
    asyncio.run(record(path))
    return path


def test_no_order_is_better_than_the_optimum(recording: Path, tmp_path: Path) -> None:
    file = tmp_path / "optimal.json"
    assert optimal.run([str(recording), "--sizes", "6,4", "--states", "3", "--json", str(file)]) == 0
    results = msgspec.json.decode(file.read_bytes(), type=Results)
    assert [size.vehicles for size in results.sizes] == [4, 6]
    assert results.candidates == 8
    for each in (state for size in results.sizes for state in size.states):
        assert each.solved
        assert each.optimal is not None
        assert each.bound <= each.optimal * (1.0 + 1e-5)
        assert min(each.auction, each.full_rows) >= each.optimal * (1.0 - 1e-5)
        assert min(each.optimal_s, each.auction_s, each.full_rows_s) > 0.0


def test_sizes_grow_until_the_limit_is_hit(recording: Path) -> None:
    *_, results = optimal.compare(recording, [12, 16, 20], 9, 1e-3)
    assert [size.vehicles for size in results.sizes] == [12]
    assert len(results.sizes[0].states) == optimal.GIVEN_UP
    assert not any(each.solved for each in results.sizes[0].states)
    assert results.ended == "3 of 3 states of 12 vehicles not solved in 0.001 s"


def test_it_says_that_there_are_no_larger_states(recording: Path) -> None:
    *_, results = optimal.compare(recording, [4, 64], 1, 60.0)
    assert [size.vehicles for size in results.sizes] == [4]
    assert results.ended == "never 64 vehicles without a clearance at a time"


def test_an_interrupted_comparison_goes_on_from_its_file(recording: Path, tmp_path: Path) -> None:
    file = tmp_path / "optimal.json"
    interrupted = next(optimal.compare(recording, [4, 6], 2, 60.0))
    write(file, interrupted)
    assert optimal.run([str(recording), "--sizes", "4,6", "--states", "2", "--json", str(file)]) == 0
    results = msgspec.json.decode(file.read_bytes(), type=Results)
    assert [size.vehicles for size in results.sizes] == [4, 6]
    assert results.sizes[0] == interrupted.sizes[0], "what is there is not timed again"
    assert (interrupted.ended, results.ended) == (None, "no more were asked for")
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"limit_s": 1.0}, "holds results with limit_s 1.0, not 60.0; choose another --json"),
        ({"digest": "other"}, "holds results with digest other, not"),
        ({"states": "many"}, "not results that can be gone on from: Expected `int`"),
    ],
)
def test_results_of_anything_else_are_not_gone_on_from(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, object], message: str
) -> None:
    file = tmp_path / "optimal.json"
    asked = [str(recording), "--sizes", "4", "--states", "1", "--json", str(file)]
    assert optimal.run(asked) == 0
    other = msgspec.json.encode(msgspec.json.decode(file.read_bytes()) | change)
    file.write_bytes(other)
    capsys.readouterr()
    assert optimal.run(asked) == 2
    assert f"gameopt_im.optimal: {file}: {message}" in capsys.readouterr().err
    assert file.read_bytes() == other


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.mcap"], "missing.mcap: No such file or directory"),
        (["{recording}", "--sizes", "4,x"], "'4,x'; allowed: whole numbers from 2 to 64, separated by commas"),
        (["{recording}", "--sizes", "64"], "never 64 vehicles without a clearance at a time"),
        (["{recording}", "--states", "0"], "--states"),
        ([], "RECORDING.mcap"),
    ],
)
def test_what_cannot_be_compared_is_one_line(
    recording: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert optimal.run([each.format(recording=recording) for each in arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert line.startswith("gameopt_im.optimal: ")
    assert message in line
