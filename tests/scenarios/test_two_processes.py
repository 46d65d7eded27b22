"""Manager and vehicles as two processes over Zenoh, with SUMO: the main job, end to end."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from processes import (
    Ended,
    Observer,
    command,
    decoded,
    depart_near,
    free_endpoint,
    manager,
    numbers,
    run,
    vehicles,
)

from gameopt_im.recorder import Recorder, read
from gameopt_sumo.scenarios import FourArm, write_four_arm
from gameopt_vehicles.report import Report
from gameopt_vehicles.strategies import preference_of
from gameopt_wire import codec

pytestmark = pytest.mark.processes

DURATION_S = 20.0
SEED = 7


class Driven(NamedTuple):
    """What is left of a run."""

    ended: Ended
    report: dict[str, Any]
    trace: str
    """Digest of SUMO's own trace of every vehicle and step."""


@pytest.fixture(scope="module")
def sumocfg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = FourArm(flow_veh_h=6000.0, ratio=2.0, seed=101, duration_s=60.0)
    return depart_near(write_four_arm(scenario, tmp_path_factory.mktemp("scenario")))


async def drive(sumocfg: Path, endpoint: str, out: Path, *arguments: object, clock: str = "lockstep") -> Driven:
    report, fcd = out.with_suffix(".json"), out.with_suffix(".xml")
    ended = await vehicles(
        *(sumocfg, endpoint, "--seed", SEED, "--report", report, *arguments),
        *("--", "--fcd-output", fcd, "--fcd-output.acceleration", "--precision", "9"),
        clock=clock,
    )
    assert ended.code == 0, ended.err
    return Driven(ended, json.loads(report.read_bytes()), digest(fcd))


def digest(fcd: Path) -> str:
    """Of the trace without the comment at its head, which has the date."""
    trace = re.sub(r"<!--.*?-->", "", fcd.read_text(), flags=re.DOTALL)
    return hashlib.sha256(trace.encode()).hexdigest()


class Lockstep(NamedTuple):
    """Runs of one scenario and seed, by the manager's number of workers; `again` is a second run of one."""

    by_workers: dict[int, Driven]
    again: Driven
    recordings: dict[int, Path]
    traffic: list[tuple[str, bytes]]
    charter: bytes


@pytest.fixture(scope="module")
def lockstep(sumocfg: Path, tmp_path_factory: pytest.TempPathFactory) -> Lockstep:
    out = tmp_path_factory.mktemp("lockstep")
    found: list[Lockstep] = []

    async def scenario() -> None:
        by_workers, recordings = {}, {}
        for workers in (0, 1, 2):
            recordings[workers] = out / f"{workers}.mcap"
            endpoint = free_endpoint()
            serving = ("--workers", workers, "--record", recordings[workers])
            async with manager(*serving, endpoint=endpoint):
                duration = ("--duration", DURATION_S)
                by_workers[workers] = await drive(sumocfg, endpoint, out / f"{workers}", *duration)
                if workers == 0:
                    async with Observer(endpoint) as observer:
                        again = await drive(sumocfg, endpoint, out / "again", *duration)
                        charter = await observer.charter()
        found.append(Lockstep(by_workers, again, recordings, observer.heard, charter))

    run(scenario)
    return found[0]


def timeless(report: dict[str, Any]) -> dict[str, Any]:
    """Without what the clock on the wall says, and without the number of workers that is compared."""
    counted = {"control_cycle": ("count", "missed"), "round_trip": ("count", "unanswered")}
    counted |= {"whole_way": ("vehicles", "commands_lost")}
    counts = {part: {name: report[part][name] for name in names} for part, names in counted.items()}
    return report | counts | {"workers": None}


def commands(recording: Path, count: int) -> Iterator[bytes]:
    """The first recorded commands, but for the manager's term, which is the time it started at."""
    for cycle, _ in zip(read(recording).cycles(), range(count), strict=False):
        for each in cycle.commands:
            yield codec.COMMAND.encode(msgspec.structs.replace(each, term=0))


def test_twenty_seconds_end_to_end(lockstep: Lockstep) -> None:
    ended, found, _ = lockstep.by_workers[1]
    assert (ended.code, ended.err) == (0, "")
    report = msgspec.convert(found, Report)  # every field, of its type
    assert set(found) == set(Report.__struct_fields__)
    assert (report.clock, report.workers, report.profile, report.seed) == ("lockstep", 1, "default", SEED)
    assert (report.flow_veh_h, report.ratio) == (6000.0, 2.0)
    assert (report.duration_s, report.control_cycle.count) == (DURATION_S, 200)
    assert (report.safety.collisions_sumo, report.safety.collisions_geometric, report.safety.teleports) == (*(0, 0, 0),)
    assert report.vehicles.crossed is not None
    assert report.vehicles.crossed > 10
    assert report.qp.solved > 100
    assert (report.qp.late, report.fallbacks, report.messages.rejected) == (0, 0, 0)
    assert "QPs solved / failed / late" in ended.out


def test_the_same_seed_gives_the_same_run_for_any_number_of_workers(lockstep: Lockstep) -> None:
    runs = [*lockstep.by_workers.values(), lockstep.again]
    assert len({each.trace for each in runs}) == 1
    first = timeless(runs[0].report)
    assert all(timeless(each.report) == first for each in runs)
    sent = [list(commands(path, 200)) for path in lockstep.recordings.values()]
    assert len(sent[0]) > 1000
    assert sent[0] == sent[1] == sent[2]


def test_a_recording_of_the_run_replays_and_a_tampered_one_does_not(lockstep: Lockstep, tmp_path: Path) -> None:
    original = read(lockstep.recordings[2])
    tampered = tmp_path / "tampered.mcap"
    done = None
    with Recorder(tampered, original.charter, original.parameters, original.options) as recorder:
        for cycle in original.cycles():
            content = cycle.commands
            if done is None and content:
                done = msgspec.structs.replace(content[0], price=content[0].price + 1e-6)
                content = [done, *content[1:]]
            recorder.record(cycle.tick, content)
    assert done is not None

    async def scenario() -> None:
        whole = await command("gameopt_im", "replay", lockstep.recordings[2])
        assert (whole.code, whole.out) == (0, "200 control cycles, every command as recorded\n"), whole.err
        changed = await command("gameopt_im", "replay", tampered)
        assert changed.code == 1
        assert f"vehicle {done.vehicle}, price: recorded" in changed.out

    run(scenario)


def test_aggressiveness_is_in_no_message(lockstep: Lockstep) -> None:
    """All traffic of a run, and the manager's own word: no number in it is anybody's d."""
    states = [codec.STATE.decode(payload) for key, payload in lockstep.traffic if "/state/" in key]
    classes = {state.vehicle: state.vehicle_class for state in states}
    secrets = {name: preference_of(SEED, name, kind).aggressiveness for name, kind in classes.items()}
    assert len(secrets) > 10
    assert {key.split("/")[2] for key, _ in lockstep.traffic} >= {
        "state",
        "bid",
        "command",
        "cycle",
        "ledger",
    }
    payloads = [payload for _, payload in lockstep.traffic] + [lockstep.charter]
    said = sorted({number for payload in payloads for number in numbers(decoded(payload))})
    assert len(said) > 5_000
    near = [(name, number) for name, secret in secrets.items() for number in said if abs(number - secret) <= 1e-9]
    assert near == []
    # the truthful bid is there, so the search would find what is said
    bids = {codec.BID.decode(payload).assertiveness for key, payload in lockstep.traffic if "/bid/" in key}
    assert bids <= set(said)


def test_wall_clock_misses_no_control_cycle(sumocfg: Path, tmp_path: Path) -> None:
    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager(endpoint=endpoint, clock="wall"):
            driven = await drive(*(sumocfg, endpoint, tmp_path / "run", "--duration", 11, "--warmup", 1), clock="wall")
        report = driven.report
        assert report["clock"] == "wall"
        assert report["control_cycle"]["missed"] == 0
        assert 95 <= report["control_cycle"]["count"] <= 105
        assert report["qp"]["solved"] > 0
        assert report["safety"]["collisions_sumo"] == report["safety"]["collisions_geometric"] == 0

    run(scenario)


def test_lost_and_late_messages_do_not_make_vehicles_collide(sumocfg: Path, tmp_path: Path) -> None:
    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager("--workers", 0, endpoint=endpoint):
            faults = ("--loss", 0.1, "--delay-ms", 100, "--jitter-ms", 50)
            driven = await drive(sumocfg, endpoint, tmp_path / "run", "--duration", 40, *faults)
        report = driven.report
        assert report["messages"]["lost"] > 100
        assert report["vehicles"]["crossed"] > 10
        assert report["safety"]["collisions_sumo"] == report["safety"]["collisions_geometric"] == 0

    run(scenario)
