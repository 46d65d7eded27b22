"""The command `gameopt-im`: what it makes of its options, and the one line it says when they are no good."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from pathlib import Path
from typing import Any

import msgspec
import pytest
import structlog

from gameopt_im import cli, logs, service
from gameopt_im.bus import BusError
from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters
from gameopt_im.options import DEFAULT_ENDPOINT, ServeOptions
from gameopt_im.recorder import Recorder
from gameopt_im.replay import Difference, Replayed
from gameopt_im.web import address
from gameopt_im.web.address import Address
from gameopt_wire.intersection import IntersectionMap

MAP = Path(__file__).parents[1] / "maps" / "crossroads.json"
ROADS = msgspec.json.decode(MAP.read_bytes(), type=IntersectionMap)


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[ServeOptions]:
    """What the service was asked for; it ends at once."""
    asked: list[ServeOptions] = []

    async def serve(options: ServeOptions) -> None:
        asked.append(options)

    monkeypatch.setattr(service, "serve", serve)
    return asked


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert cli.run(arguments) == cli.BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("gameopt-im: ")
    assert err.count("\n") == 1
    return err.removeprefix("gameopt-im: ").rstrip("\n")


def test_defaults(served: list[ServeOptions]) -> None:
    arguments = ("serve", "--map", str(MAP))
    assert cli.run(arguments) == 0
    (options,) = served
    assert options == ServeOptions(
        map=ROADS, parameters=Parameters(), listen=(DEFAULT_ENDPOINT,), http=address.DEFAULT, command_line=arguments
    )
    assert options.workers >= 1
    assert options.candidates == len(Parameters().auction.weights)


def test_everything_said_arrives(served: list[ServeOptions], tmp_path: Path) -> None:
    config = tmp_path / "im.toml"
    config.write_text("[auction]\nweights = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]\n")
    zenoh = "--listen tcp/0.0.0.0:1 --listen tcp/[::1]:1 --connect tcp/hub:2 --zenoh-config z.json5"
    planner = "--clock lockstep --profile paper --ignore-turn-speed --candidates 2 --workers 0"
    output = "--http 0.0.0.0:80 --record run.mcap --log-format json"
    said = f"{zenoh} {planner} {output}".split()
    arguments = ("serve", "--config", str(config), "--map", str(MAP), *said)
    assert cli.run(arguments) == 0
    (options,) = served
    assert options.parameters.auction.weights == [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0)]
    assert options == ServeOptions(
        map=ROADS,
        parameters=options.parameters,
        profile="paper",
        geometry="box",
        turn_speed=False,
        candidates=2,
        workers=0,
        clock="lockstep",
        listen=("tcp/0.0.0.0:1", "tcp/[::1]:1"),
        connect=("tcp/hub:2",),
        zenoh_config=Path("z.json5"),
        http=Address("0.0.0.0", 80),
        record=Path("run.mcap"),
        log_format="json",
        command_line=arguments,
    )


def test_the_web_server_can_be_left_out(served: list[ServeOptions]) -> None:
    assert cli.run(("serve", "--map", str(MAP), "--http", "off")) == 0
    assert served[0].http is None


@pytest.mark.parametrize(
    ("said", "geometry"),
    [
        ((), "areas"),
        (("--profile", "paper"), "box"),
        (("--geometry", "box"), "box"),
        (("--profile", "paper", "--geometry", "box"), "box"),
    ],
)
def test_the_geometry_follows_the_profile(served: list[ServeOptions], said: tuple[str, ...], geometry: str) -> None:
    assert cli.run(("serve", "--map", str(MAP), *said)) == 0
    assert served[0].geometry == geometry


@pytest.mark.parametrize("said", [("--connect", "tcp/hub:1"), ("--zenoh-config", "z.json5")])
def test_who_joins_a_network_does_not_listen_unasked(served: list[ServeOptions], said: tuple[str, ...]) -> None:
    assert cli.run(("serve", "--map", str(MAP), *said)) == 0
    assert served[0].listen == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "Missing command"),
        (("serve", "--wat"), "No such option"),
        (
            ("serve", "--clock", "sand"),
            "Invalid value for '--clock': 'sand' is not one of 'wall', 'lockstep'",
        ),
        (("serve", "--workers", "-1"), "Invalid value for '--workers': -1 is not in the range 0<=x<=64"),
        (("serve", "--candidates", "0"), "Invalid value for '--candidates': 0 is not in the range 1<=x<=64"),
        (("serve", "--map", str(MAP), "--candidates", "9"), "--candidates: allowed: 1 to 8, the number of"),
        (
            ("serve", "--map", str(MAP), "--profile", "paper", "--geometry", "areas"),
            "--geometry: areas is refused",
        ),
        (
            ("serve", "--http", "8080"),
            "Invalid value for '--http': '8080'; allowed: HOST:PORT such as 127.0.0.1:8080 or [::1]:8080, or off",
        ),
        (("serve", "--map", str(MAP), "--junction", "J"), "--junction: allowed only with --map FILE.net.xml"),
        (("serve", "--articulated"), "--articulated: allowed only with --map FILE.net.xml"),
        (("serve", "--map", "none.json"), "none.json: No such file or directory"),
        (("serve", "--map", "none.net.xml"), "none.net.xml: no such file"),
        (("serve", "--config", "none.toml"), "none.toml: No such file or directory"),
        (("replay",), "Missing argument 'FILE.mcap'"),
        (("replay", "none.mcap"), "none.mcap: No such file or directory"),
    ],
)
def test_bad_arguments_are_one_line(
    capsys: pytest.CaptureFixture[str], served: list[ServeOptions], arguments: tuple[str, ...], message: str
) -> None:
    assert refusal(capsys, *arguments).startswith(message)
    assert served == []


def spoiled_map(change: Any) -> bytes:
    content = json.loads(MAP.read_bytes())
    change(content)
    return json.dumps(content).encode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "not an intersection map: Input data was truncated"),
        (b"\xff", "not an intersection map: "),
        (b"{}", "not an intersection map: Object missing required field"),
        (
            spoiled_map(lambda roads: roads["lanes"][0].update(zone_m=-1)),
            "not an intersection map: Expected `float` > 0.0 - at `$.lanes[0].zone_m`",
        ),
        (spoiled_map(lambda roads: roads["movements"][0].update(lane=7)), "movement '0-1': lane 7 of 2"),
        (
            spoiled_map(lambda roads: roads["movements"][1].update(id="0-1")),
            "movements: the id '0-1' is there twice",
        ),
        (spoiled_map(lambda roads: roads["areas"][0].update(b=9)), "conflict area 0-9: wants a < b < 3"),
        (
            spoiled_map(lambda roads: roads["areas"][0].update(a_windows_m=[])),
            "conflict area 0-2: wants 2 x 2",
        ),
    ],
)
def test_a_broken_map_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, content: bytes, message: str
) -> None:
    path = tmp_path / "map.json"
    path.write_bytes(content)
    assert refusal(capsys, "serve", "--map", str(path)).startswith(f"{path}: {message}")


def test_what_fails_at_the_start_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def serve(_: ServeOptions) -> None:
        raise BusError("tcp/127.0.0.1:7447: Address already in use")

    monkeypatch.setattr(service, "serve", serve)
    message = refusal(capsys, "serve", "--map", str(MAP))
    assert message == "tcp/127.0.0.1:7447: Address already in use"


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly(monkeypatch: pytest.MonkeyPatch, signum: signal.Signals) -> None:
    steps: list[str] = []

    async def serve(_: ServeOptions) -> None:
        try:
            os.kill(os.getpid(), signum)
            await asyncio.Event().wait()
        finally:
            await asyncio.to_thread(steps.append, "closed")

    monkeypatch.setattr(service, "serve", serve)
    assert cli.run(("serve", "--map", str(MAP))) == 0
    assert steps == ["closed"]


@pytest.mark.parametrize("arguments", [("--help",), ("serve", "--help"), ("replay", "--help")])
def test_help_is_there(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    assert cli.run(arguments) == 0
    assert "Usage: gameopt-im" in capsys.readouterr().out


def test_help_tells_units_and_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    cli.run(("serve", "--help"))
    text = " ".join(capsys.readouterr().out.split())
    for said in (
        "every 100 ms",
        "default: wall",
        "tcp/127.0.0.1:7447",
        "areas; box under --profile paper",
        "127.0.0.1:8080",
    ):
        assert said in text


def recording(path: Path) -> Path:
    charter = service.charter_of(ServeOptions(map=ROADS, parameters=Parameters(), clock="lockstep"), 1)
    with Recorder(path, charter, Parameters(), ()) as recorder:
        recorder.record(Tick(1, 0.1, []), [])
    return path


@pytest.mark.parametrize(
    ("difference", "outcome"),
    [
        (None, (0, "1 control cycles, every command as recorded\n")),
        (
            Difference(1, "a", "speed_mps", 1.0, 2.0),
            (1, "control cycle 1, vehicle a, speed_mps: recorded 1.0, replayed 2.0\n"),
        ),
    ],
)
def test_a_replay_tells_how_it_went(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    difference: Difference | None,
    outcome: tuple[int, str],
) -> None:
    async def again(*_: Any) -> Replayed:
        return Replayed(1, difference)

    monkeypatch.setattr("gameopt_im.replay.replay", again)
    code = cli.run(("replay", str(recording(tmp_path / "run.mcap"))))
    assert (code, capsys.readouterr().out) == outcome


def test_logs_are_lines_or_json_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("json")
    structlog.get_logger().warning("vehicle lost", vehicle="a", heard_s=1.5)
    out, err = capsys.readouterr()
    assert out == ""
    entry = json.loads(err)
    assert (entry["event"], entry["level"], entry["vehicle"], entry["heard_s"]) == (
        "vehicle lost",
        "warning",
        "a",
        1.5,
    )
    logs.configure("text")
    structlog.get_logger().info("serving", clock="wall")
    out, err = capsys.readouterr()
    assert out == ""
    assert "serving" in err
    assert "clock=wall" in err
    assert "\x1b" not in err
