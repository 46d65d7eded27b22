"""The command `gameopt-vehicles` as a process, against a Zenoh session that answers as a manager does."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from stand_in import StandIn, hold_speed, run

from gameopt_sumo.network import read_map
from gameopt_sumo.scenarios import FourArm, write_four_arm

pytestmark = pytest.mark.processes


async def command(*arguments: str, during: Callable[[Any], Awaitable[None]] | None = None) -> tuple[int, str, str]:
    """`gameopt-vehicles` in a process of its own: exit code, stdout, stderr."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        "from gameopt_vehicles.cli import main; main()",
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    if during is not None:
        await during(process)
    out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


def test_command_writes_the_report_and_the_table(tmp_path: Path) -> None:
    file = tmp_path / "report.json"

    async def scenario() -> None:
        async with StandIn() as manager:
            code, out, err = await command(
                *("--synthetic", "12", "--connect", manager.endpoint, "--clock", "lockstep"),
                *("--duration", "10", "--warmup", "2", "--seed", "4", "--report", str(file)),
            )
        assert (code, err) == (0, "")
        assert "control cycle, p50 / p99 / max" in out
        report = json.loads(file.read_text())
        assert report["schema"] == "gameopt-report/1"
        assert (report["method"], report["intersection"], report["clock"]) == ("coop", "main/1", "lockstep")
        assert (report["duration_s"], report["warmup_s"], report["seed"]) == (10.0, 2.0, 4)
        assert report["control_cycle"]["count"] == 80
        assert report["qp"]["solved"] == 80
        assert report["safety"]["collisions_sumo"] is None

    run(scenario)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_command_ends_cleanly_on_signals(tmp_path: Path, number: signal.Signals) -> None:
    file = tmp_path / "report.json"

    async def scenario() -> None:
        async with StandIn() as manager:

            async def interrupt(process: Any) -> None:
                await manager.answered.wait()
                process.send_signal(number)

            code, _, err = await command(
                *("--synthetic", "4", "--connect", manager.endpoint, "--clock", "lockstep"),
                *("--duration", "100000", "--report", str(file)),
                during=interrupt,
            )
        assert (code, err) == (0, "")
        assert 0.0 < json.loads(file.read_text())["duration_s"] < 100_000

    run(scenario)


@pytest.mark.parametrize(
    ("charter", "says"),
    [
        ({"clock": "wall"}, "--clock wall"),
        ({"turn_speed": False}, "--ignore-turn-speed"),
        ({"digest": "0" * 16}, "map"),
    ],
)
def test_command_refuses_a_manager_that_differs(charter: dict[str, Any], says: str) -> None:
    async def scenario() -> None:
        async with StandIn(**charter) as manager:
            code, out, err = await command("--synthetic", "4", "--connect", manager.endpoint, "--clock", "lockstep")
        assert (code, out) == (3, "")
        assert len(err.splitlines()) == 1
        assert says in err

    run(scenario)


def test_command_without_a_manager_says_so_within_seconds() -> None:
    async def scenario() -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"  # bound, so nobody listens on it
            began_s = time.monotonic()
            code, _, err = await command("--synthetic", "4", "--connect", endpoint)
        assert code == 3
        assert len(err.splitlines()) == 1
        assert endpoint in err
        assert time.monotonic() - began_s < 6.0

    run(scenario)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "exactly one of --sumo"),
        (("--synthetic", "0"), "--synthetic"),
        (("--synthetic", "3", "--loss", "nan"), "--loss"),
        (("--synthetic", "3", "--duration", "10", "--warmup", "10"), "--warmup"),
        (("--synthetic", "3", "--connect", "nowhere"), "nowhere"),
        (("--synthetic", "3", "--strategy", "greedy"), "overbid"),
        (("--synthetic", "3", "--aggressiveness", "taxi=2"), "allowed: CLASS=D with D from 0 to 1"),
        (("--synthetic", "3", "--aggressiveness", "taxi"), "allowed: CLASS=D with D from 0 to 1"),
        (("--synthetic", "3", "--aggressiveness", "=0.5"), "allowed: CLASS=D with D from 0 to 1"),
        (("--synthetic", "3", "--report", "no/such/directory/x.json"), "no/such/directory"),
        (("--synthetic", "3", "--zenoh-config", "{broken}"), "broken.json5"),
        (("--synthetic", "3", "--", "--no-warnings"), "--sumo"),
        (("--sumo", "absent.sumocfg"), "absent.sumocfg"),
        (("--sumo", "{broken}"), "broken.json5"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    broken = tmp_path / "broken.json5"
    broken.write_text("{mode:")

    async def scenario() -> None:
        filled = [argument.replace("{broken}", str(broken)) for argument in arguments]
        code, out, err = await command(*filled)
        assert (code, out) == (2, "")
        assert len(err.splitlines()) == 1
        assert says in err

    run(scenario)


def on_sumo(directory: Path, decide: Callable[..., Any]) -> tuple[int, str, dict[str, Any]]:
    """30 s of a four-arm scenario under a stand-in: exit code, stderr, report."""
    config = write_four_arm(FourArm(flow_veh_h=9000.0, duration_s=60.0), directory)
    the_map = read_map(directory / "four-arm.net.xml")
    result: list[tuple[int, str]] = []

    async def scenario() -> None:
        async with StandIn(decide, map=the_map, digest=the_map.digest()) as manager:
            code, _, err = await command(
                *("--sumo", str(config), "--connect", manager.endpoint, "--clock", "lockstep"),
                *("--duration", "30", "--report", str(directory / "report.json")),
            )
            result.append((code, err))

    run(scenario)
    return *result[0], json.loads((directory / "report.json").read_text())


def test_without_commands_sumo_vehicles_queue_at_the_line(tmp_path: Path) -> None:
    code, err, report = on_sumo(tmp_path, lambda *_: [])
    assert (code, err) == (0, "")
    assert report["scenario"] == "four-arm"
    assert report["vehicles"]["crossed"] == 0
    entered = report["vehicles"]["entered"]
    assert entered > 30
    assert entered - 5 <= report["fallbacks"] <= entered  # the last to come are not abandoned yet
    assert report["safety"]["collisions_sumo"] == report["safety"]["collisions_geometric"] == 0


def test_collisions_are_exit_4_with_the_report_written(tmp_path: Path) -> None:
    code, err, report = on_sumo(tmp_path, hold_speed)
    assert code == 4
    assert err == "gameopt-vehicles: vehicles collided; see the report\n"
    assert report["safety"]["collisions_geometric"] > 0
