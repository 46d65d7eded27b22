"""Recordings: what was written comes back byte for byte; a replay finds the first command that differs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters, Program
from gameopt_im.inbox import Raw
from gameopt_im.recorder import RecordedCycle, Recorder, RecordError, read
from gameopt_im.replay import Difference, Replayed, first_difference, replay
from gameopt_wire.intersection import Charter, IntersectionMap
from gameopt_wire.messages import Clearance, Command

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
PARAMETERS = Parameters(program=Program(lambda_=0.6))
OPTIONS = ("serve", "--record", "run.mcap")
CHARTER = Charter(
    term=5,
    clock="lockstep",
    profile="default",
    geometry="areas",
    turn_speed=True,
    candidates=8,
    workers=1,
    process_id=1,
    digest=ROADS.digest(),
    map=ROADS,
)


def command(vehicle: str = "a", cycle: int = 1, speed_mps: float = 12.5) -> Command:
    return Command(
        vehicle=vehicle,
        term=5,
        cycle=cycle,
        time_s=cycle / 10,
        speed_mps=speed_mps,
        valid_until_s=cycle / 10 + 0.5,
        slot_s=17.25,
        clearance=Clearance(id=3, start_s=0.1, expires_s=0.6, speeds_mps=[12.5, 12.6, 12.7]),
        rank=0,
        price=1 / 3,
    )


RUN = [
    RecordedCycle(
        Tick(1, 0.1, [Raw("state", b"\x00\xff", "gameopt/x/state/a"), Raw("bid", b"", "gameopt/x/bid/a")]),
        [command(), command("b")],
    ),
    RecordedCycle(Tick(2, 0.2, [Raw("gone", b"", "gameopt/x/alive/b")], ahead=1), []),
    RecordedCycle(Tick(1, 0.1, [], restarted=True), [command()]),
]


def write(path: Path, run: list[RecordedCycle]) -> Path:
    with Recorder(path, CHARTER, PARAMETERS, OPTIONS) as recorder:
        for recorded in run:
            recorder.record(recorded.tick, recorded.commands)
    return path


def test_a_recording_comes_back_as_it_was(tmp_path: Path) -> None:
    recording = read(write(tmp_path / "run.mcap", RUN))
    assert list(recording.cycles()) == RUN
    assert (recording.charter, recording.parameters, recording.options) == (CHARTER, PARAMETERS, OPTIONS)
    assert list(recording.cycles()) == RUN  # reading does not use it up


def test_times_beyond_what_the_container_can_stamp_are_kept(tmp_path: Path) -> None:
    run = [RecordedCycle(Tick(2**62, 1e11, []), [])]
    assert list(read(write(tmp_path / "run.mcap", run)).cycles()) == run


def test_closing_twice_is_closing_once_and_then_nothing_is_written(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", CHARTER, PARAMETERS, OPTIONS)
    recorder.close()
    recorder.close()
    with pytest.raises(RecordError, match="already closed"):
        recorder.record(Tick(1, 0.1, []), [])
    assert list(read(tmp_path / "run.mcap").cycles()) == []


def test_a_file_cut_short_ends_with_its_last_complete_control_cycle(tmp_path: Path) -> None:
    payload = bytes(range(256)) * 400  # so that several chunks reach the disk
    run = [RecordedCycle(Tick(k, k / 10, [Raw("state", payload, f"k/{k}")]), []) for k in range(20)]
    path = write(tmp_path / "run.mcap", run)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    cycles = list(read(path).cycles())
    assert 0 < len(cycles) < 20
    assert cycles == run[: len(cycles)]


@pytest.mark.parametrize("content", [b"", b"not an mcap file at all", b"\x89MCAP0\r\n" + b"\xff" * 40])
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: not a")
    assert "\n" not in str(caught.value)


def test_a_place_that_cannot_be_written_or_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"no/run\.mcap: No such file or directory$"):
        Recorder(tmp_path / "no" / "run.mcap", CHARTER, PARAMETERS, OPTIONS)
    with pytest.raises(RecordError, match=r"none\.mcap: No such file or directory$"):
        read(tmp_path / "none.mcap")


@dataclass
class Outcome:
    commands: list[Command]


class Parrot:
    """A service that decides what it is told to decide."""

    def __init__(self, decide: Callable[[int], list[Command]]) -> None:
        self.decide = decide
        self.heard: list[Tick] = []
        self.ahead: list[Raw] = []
        self.restarts = 0

    def read_ahead(self, messages: Sequence[Raw], time_s: float) -> int:
        self.ahead.extend(messages)
        return len(messages)

    async def control_cycle(self, cycle: int, time_s: float, messages: list[Raw]) -> Outcome:
        assert messages[: len(self.ahead)] == self.ahead
        self.heard.append(Tick(cycle, time_s, messages, ahead=len(self.ahead)))
        self.ahead.clear()
        return Outcome(self.decide(cycle))

    def restart(self) -> None:
        self.restarts += 1
        self.heard.clear()


def run_again(path: Path, decide: Callable[[int], list[Command]]) -> tuple[Replayed, Parrot]:
    parrot = Parrot(decide)
    return asyncio.run(replay(read(path), lambda _: nullcontext(parrot)), debug=True), parrot


def test_a_replay_feeds_what_was_recorded(tmp_path: Path) -> None:
    replayed, parrot = run_again(write(tmp_path / "run.mcap", RUN[:2]), lambda k: RUN[k - 1].commands)
    assert replayed == Replayed(2, None)
    assert parrot.heard == [RUN[0].tick, RUN[1].tick]


def test_a_replay_starts_anew_where_time_did(tmp_path: Path) -> None:
    run = [*RUN[:2], RecordedCycle(RUN[2].tick, RUN[0].commands)]
    replayed, parrot = run_again(write(tmp_path / "run.mcap", run), lambda k: RUN[k - 1].commands)
    assert replayed == Replayed(3, None)
    assert (parrot.restarts, len(parrot.heard)) == (1, 1)


def test_a_replay_stops_at_the_first_difference(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", RUN)
    replayed, _ = run_again(path, lambda _: [command(), command("b")])
    assert replayed == Replayed(2, Difference(2, "a", "command", "absent", "sent"))


def test_the_field_that_differs_is_named() -> None:
    was = command()
    assert was.clearance is not None
    other = msgspec.structs.replace(
        was, clearance=msgspec.structs.replace(was.clearance, speeds_mps=[12.5, 12.6, 12.8])
    )
    difference = first_difference(4, [command("b"), was], [command("b"), other])
    assert difference == Difference(4, "a", "clearance.speeds_mps[2]", 12.7, 12.8)
    assert str(difference) == ("control cycle 4, vehicle a, clearance.speeds_mps[2]: recorded 12.7, replayed 12.8")
    refused = msgspec.structs.replace(was, clearance=None)
    assert first_difference(4, [was], [refused]) == Difference(4, "a", "clearance", was.clearance, None)
    assert first_difference(4, [was], []) == Difference(4, "a", "command", "sent", "absent")
    assert first_difference(4, [was], [was]) is None
