"""The commands as processes, and a session beside them that hears everything; no test in here.

Nothing sleeps to synchronise: tests wait for a line, a message or an exit code, each within `PATIENCE_S`.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec
import uvloop
import zenoh

from gameopt_sumo.scenarios import DEMAND_FILE
from gameopt_wire import codec, keys
from gameopt_wire.messages import CycleReport

PATIENCE_S = 120.0
"""Nothing takes this long; what would otherwise hang fails instead."""


def run(scenario: Callable[[], Coroutine[Any, Any, None]]) -> None:
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(scenario())


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Ended(NamedTuple):
    """A process that is over."""

    code: int
    out: str
    err: str


class Running:
    """One of the commands, in a process of its own, with warnings as errors."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._lines: list[str] = []
        self._more = asyncio.Condition()
        assert process.stdout is not None
        self._out = asyncio.create_task(process.stdout.read())
        self._err = asyncio.create_task(self._read_err())

    @classmethod
    async def start(cls, package: str, *arguments: object) -> Self:
        """`package` is that of the command, e.g. `gameopt_im`."""
        code = f"from {package}.cli import main; main()"
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-W", "error", "-c", code, *map(str, arguments)),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        return cls(process)

    async def said(self, words: str) -> str:
        """The first line on stderr with these words, past or to come."""
        async with asyncio.timeout(PATIENCE_S), self._more:
            await self._more.wait_for(lambda: self._err.done() or self._heard(words) is not None)
        line = self._heard(words)
        assert line is not None, self._lines
        return line

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    async def ended(self) -> Ended:
        async with asyncio.timeout(PATIENCE_S):
            out, _ = await asyncio.gather(self._out, self._err)
            code = await self._process.wait()
        return Ended(code, out.decode(), "".join(self._lines))

    async def stop(self) -> Ended:
        """SIGTERM, as an operator would; whatever is over already stays as it ended."""
        with contextlib.suppress(ProcessLookupError):
            self.signal(signal.SIGTERM)
        try:
            return await self.ended()
        except TimeoutError:
            self._process.kill()
            raise

    def _heard(self, words: str) -> str | None:
        return next((line for line in self._lines if words in line), None)

    async def _read_err(self) -> None:
        assert self._process.stderr is not None
        try:
            async for line in self._process.stderr:
                async with self._more:
                    self._lines.append(line.decode())
                    self._more.notify_all()
        finally:
            async with self._more:
                self._more.notify_all()


async def command(package: str, *arguments: object) -> Ended:
    """A command from start to end."""
    return await (await Running.start(package, *arguments)).ended()


@asynccontextmanager
async def manager(*arguments: object, endpoint: str, clock: str = "lockstep") -> AsyncIterator[Running]:
    """`gameopt-im serve`, once it is serving; it has to end cleanly unless a test has killed it."""
    running = await Running.start("gameopt_im", "serve", "--listen", endpoint, "--clock", clock, *arguments)
    try:
        await running.said("serving ")
        yield running
    finally:
        ended = await running.stop()
    assert ended.code in (0, -signal.SIGKILL), ended.err


async def vehicles(sumocfg: object, endpoint: str, *arguments: object, clock: str = "lockstep") -> Ended:
    """`gameopt-vehicles` on a scenario, from start to end."""
    return await command("gameopt_vehicles", *driving(sumocfg, endpoint, *arguments, clock=clock))


def driving(sumocfg: object, endpoint: str, *arguments: object, clock: str = "lockstep") -> tuple[object, ...]:
    """The arguments of a drive."""
    return ("--sumo", sumocfg, "--connect", endpoint, "--clock", clock, *arguments)


class Observer:
    """A session of its own that hears all of gameopt's traffic, or a part, and can talk, too."""

    def __init__(self, endpoint: str, hears: str = f"{keys.ROOT}/**") -> None:
        self.heard: list[tuple[str, bytes]] = []
        self.reports: list[CycleReport] = []
        self.on_report: Callable[[CycleReport], None] | None = None
        self._endpoint, self._hears = endpoint, hears
        self._loop = asyncio.get_running_loop()
        self._more = asyncio.Event()

    async def __aenter__(self) -> Self:
        config = zenoh.Config()
        for key, value in {
            "mode": '"client"',
            "connect/endpoints": f'["{self._endpoint}"]',
            "scouting/multicast/enabled": "false",
            "scouting/gossip/enabled": "false",
        }.items():
            config.insert_json5(key, value)
        self._session = await asyncio.to_thread(zenoh.open, config)
        self._subscriber = self._session.declare_subscriber(self._hears, self._arrived)
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self._session.close)

    def put(self, key: str, payload: bytes) -> None:
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    async def charter(self) -> bytes:
        """What a manager answers for its map."""
        replies = await asyncio.to_thread(lambda: list(self._session.get(f"{keys.ROOT}/*/map")))
        return bytes(replies[0].ok.payload.to_bytes())

    async def until(self, holds: Callable[[CycleReport], bool]) -> CycleReport:
        """The next report of a control cycle for which something holds."""
        seen = len(self.reports)
        async with asyncio.timeout(PATIENCE_S):
            while True:
                self._more.clear()
                for report in self.reports[seen:]:
                    if holds(report):
                        return report
                seen = len(self.reports)
                await self._more.wait()

    def messages(self, stream: str) -> list[tuple[str, bytes]]:
        """What was heard on one kind of keys."""
        return [(key, payload) for key, payload in self.heard if key.split("/")[2] == stream]

    def _arrived(self, sample: zenoh.Sample) -> None:
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        self._loop.call_soon_threadsafe(self._take, key, payload)

    def _take(self, key: str, payload: bytes) -> None:
        self.heard.append((key, payload))
        if key.endswith("/cycle"):
            with contextlib.suppress(codec.Rejected):
                self.reports.append(codec.CYCLE.decode(payload))
                if self.on_report is not None:
                    self.on_report(self.reports[-1])
        self._more.set()


def depart_near(sumocfg: Path) -> Path:
    """The scenario with departures just before the control zone: something happens from the start."""
    demand = sumocfg.with_name(DEMAND_FILE)
    demand.write_text(demand.read_text().replace('departPos="base"', 'departPos="235"'))
    return sumocfg


def numbers(value: object) -> list[float]:
    """Every number in a decoded message, whatever it is called and however deep it stands."""
    if isinstance(value, dict):
        return [number for pair in value.items() for part in pair for number in numbers(part)]
    if isinstance(value, list | tuple):
        return [number for part in value for number in numbers(part)]
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return []
    try:
        return [float(value)]
    except ValueError:
        return []


def decoded(payload: bytes) -> Any:
    """A payload without any expectation of its type."""
    return msgspec.msgpack.decode(payload)
