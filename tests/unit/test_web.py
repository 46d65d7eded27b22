"""The web server over real HTTP: what it says of a manager, and when it says nothing."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, contextmanager
from typing import Any, NamedTuple

import aiohttp
import msgspec
import pytest
import uvloop
from builders import four_arm
from prometheus_client.openmetrics import parser as openmetrics
from prometheus_client.parser import text_string_to_metric_families

from gameopt_im import vitals as vital_signs
from gameopt_im.core.parameters import Parameters
from gameopt_im.manager import Outcome
from gameopt_im.options import ServeOptions, StartError
from gameopt_im.solver.pool import Counts
from gameopt_im.vitals import Vitals
from gameopt_im.web import address, server
from gameopt_im.web.address import Address
from gameopt_im.web.hub import Hub
from gameopt_im.web.metrics import REASONS
from gameopt_wire.messages import CycleReport, LedgerEntry

OPTIONS = ServeOptions(map=four_arm(), parameters=Parameters())
ANY_PORT = Address("127.0.0.1", 0)
PATIENCE_S = 10.0
LOOPS = [asyncio.new_event_loop, uvloop.new_event_loop]


class Hands:
    """A monotonic clock turned by hand."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Answer(NamedTuple):
    status: int
    text: str
    content_type: str


class Visitor:
    """Somebody who asks a manager's web server."""

    def __init__(self, url: str, session: aiohttp.ClientSession) -> None:
        self._url, self._session = url, session

    async def get(self, path: str, accept: str = "*/*") -> Answer:
        async with self._session.get(self._url + path, headers={"Accept": accept}) as answer:
            return Answer(answer.status, await answer.text(), answer.headers["Content-Type"])

    async def scrape(self) -> dict[str, float]:
        """Every sample by its name and labels, as in the exposition."""
        return samples((await self.get("/metrics")).text)


def samples(text: str) -> dict[str, float]:
    found = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            labels = ",".join(f"{name}={value}" for name, value in sorted(sample.labels.items()))
            found[f"{sample.name}{{{labels}}}" if labels else sample.name] = sample.value
    return found


def run(work: Callable[[], Coroutine[Any, Any, None]], loop: Callable[[], Any] = uvloop.new_event_loop) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work()

    with asyncio.Runner(debug=True, loop_factory=loop) as runner:
        runner.run(bounded())


@asynccontextmanager
async def visiting(vitals: Vitals) -> AsyncIterator[Visitor]:
    async with server.opened(ANY_PORT, OPTIONS, vitals, Hub(OPTIONS, 1)) as url, aiohttp.ClientSession() as session:
        assert url is not None
        yield Visitor(url, session)


def outcome(**changes: Any) -> Outcome:
    """A control cycle with something of everything."""
    report = CycleReport(
        term=1, cycle=7, time_s=0.7, vehicles=9, uncleared=5, cleared=3, commands=8, candidates=4, selected=0,
        order=["a"], granted=["b", "c"], refused=6, withdrawn=1, delay_s=0.0, elapsed_ms=4.0,
        stages_ms={"ingest": 0.3, "programs": 2.5}, qp_solved_total=0, qp_failed_total=0, qp_late_total=0,
        missed_total=11, received_total=200, rejected_total={"malformed": 13, "overflow": 17}, fallback=2, silent=1,
        dropped_total=14, unsolved_total=3,
    )  # fmt: skip
    entry = LedgerEntry(vehicle="d", term=1, entered_s=0.1, cleared_s=0.2, price=0.5, bid=0.7)
    left = msgspec.structs.replace(entry, left_s=0.6)
    return Outcome([], msgspec.structs.replace(report, **changes), [entry, left])


@pytest.mark.parametrize("loop", LOOPS)
def test_what_has_happened_is_scraped(loop: Callable[[], Any]) -> None:
    async def work() -> None:
        hands = Hands()
        vitals = Vitals("wall", hands)
        vitals.programs = Counts(solved=30, failed=2, late=1, lost_workers=1)
        async with visiting(vitals) as visitor:
            for bids in (21, 25):
                vitals.cycle_begun()
                hands.now_s += 0.006
                vitals.cycle_done(outcome(), bids)
            found = await visitor.scrape()
        gauges = {"": 9, "_cleared": 3, "_waiting": 5, "_silent": 1, "_fallback": 2}
        assert {name: found[f"gameopt_vehicles{name}"] for name in gauges} == gauges
        totals = {
            "control_cycles": 2, "missed_control_cycles": 11, "commands": 16, "received_messages": 200,
            "overflow_messages": 17, "bids": 25, "grants": 4, "refusals": 12, "withdrawals": 2, "crossings": 2,
            "fallback_vehicle_cycles": 4, "candidates": 8, "lost_workers": 1,
            "dropped_candidates": 14, "unsolved_control_cycles": 3,
        }  # fmt: skip
        assert {name: found[f"gameopt_{name}_total"] for name in totals} == totals
        assert found["gameopt_rejected_messages_total{reason=malformed}"] == 13
        programs = {name: found[f"gameopt_solver_programs_total{{outcome={name}}}"] for name in ("solved", "failed")}
        assert programs == {"solved": 30, "failed": 2}
        assert found["gameopt_process_cpu_seconds_total"] > 0.0

    run(work, loop)


def test_the_histograms_count_what_lies_on_or_below_each_bound() -> None:
    async def work() -> None:
        hands = Hands()
        vitals = Vitals("wall", hands)
        async with visiting(vitals) as visitor:
            for elapsed_s in (0.5, 2.0):
                vitals.cycle_begun()
                hands.now_s += elapsed_s
                vitals.cycle_done(outcome(stages_ms={"programs": 1e3 * elapsed_s}, whole_ms=1e3 * elapsed_s), 0)
            found = await visitor.scrape()
        for name, labels in (("", ""), ("_stage", "stage=programs")):
            of = f"gameopt_control_cycle{name}_seconds"
            bounds = {"0.2": 0, "0.5": 1, "1.0": 1, "+Inf": 2}
            prefix = ["le={}", "le={}," + labels][bool(labels)]
            assert {le: found[f"{of}_bucket{{{prefix.format(le)}}}"] for le in bounds} == bounds
            suffix = f"{{{labels}}}" if labels else ""
            assert (found[f"{of}_count{suffix}"], found[f"{of}_sum{suffix}"]) == (2, 2.5)

    run(work)


def test_before_the_first_control_cycle_all_counters_are_there_at_zero() -> None:
    """A counter that appears with its first event looks to Prometheus as if it had not increased."""

    async def work() -> None:
        async with visiting(Vitals("wall")) as visitor:
            found = await visitor.scrape()
        ours = {name: value for name, value in found.items() if name.split("{")[0].endswith("_total")}
        del ours["gameopt_process_cpu_seconds_total"]
        assert set(ours.values()) == {0.0}
        assert {f"gameopt_rejected_messages_total{{reason={reason}}}" for reason in REASONS} <= set(ours)
        assert {"malformed", "duplicate", "overload"} <= set(REASONS)

    run(work)


def test_openmetrics_for_who_asks_for_it() -> None:
    async def work() -> None:
        async with visiting(Vitals("wall")) as visitor:
            answer = await visitor.get("/metrics", "application/openmetrics-text; version=1.0.0")
        assert answer.content_type.startswith("application/openmetrics-text; version=1.0.0")
        families = {family.name: family for family in openmetrics.text_string_to_metric_families(answer.text)}
        assert families["gameopt_manager"].samples[0].labels["intersection"] == OPTIONS.map.intersection

    run(work)


@pytest.mark.parametrize("accept", ["", "*/*", "text/plain;version=0.0.4", "application/openmetrics-text;version=new"])
def test_plain_text_for_everybody_else(accept: str) -> None:
    async def work() -> None:
        async with visiting(Vitals("wall")) as visitor:
            answer = await visitor.get("/metrics", accept)
        assert (answer.status, answer.content_type) == (200, "text/plain; version=0.0.4; charset=utf-8")
        assert samples(answer.text)["gameopt_ready"] == 0

    run(work)


def test_metrics_are_written_between_control_cycles() -> None:
    async def work() -> None:
        vitals = Vitals("wall")
        async with visiting(vitals) as visitor:
            vitals.cycle_begun()
            scraping = asyncio.create_task(visitor.scrape())
            assert (await visitor.get("/healthz")).status == 200
            assert not scraping.done()
            vitals.cycle_done(outcome(), 0)
            assert (await scraping)["gameopt_control_cycles_total"] == 1

    run(work)


def test_metrics_do_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vital_signs, "BUSY_S", 0.01)

    async def work() -> None:
        vitals = Vitals("wall")
        async with visiting(vitals) as visitor:
            vitals.cycle_begun()
            assert (await visitor.scrape())["gameopt_control_cycles_total"] == 0

    run(work)


def test_health_at_the_wall_clock() -> None:
    async def work() -> None:
        hands = Hands()
        vitals = Vitals("wall", hands)
        async with visiting(vitals) as visitor:

            async def said(path: str) -> tuple[int, str]:
                return (await visitor.get(path))[:2]

            hands.now_s += 60.0  # compiling
            assert await said("/healthz") == (200, "starting\n")
            assert await said("/readyz") == (503, "warming up\n")
            vitals.announce()
            assert [await said(path) for path in ("/healthz", "/readyz")] == [(200, "healthy\n"), (200, "ready\n")]
            hands.now_s += 0.9
            assert (await said("/healthz"))[0] == 200
            hands.now_s += 0.3
            stalled = (503, "no control cycle for 1.2 s\n")
            assert [await said(path) for path in ("/healthz", "/readyz")] == [stalled, stalled]
            vitals.cycle_begun()
            vitals.cycle_done(outcome(), 0)
            assert await said("/healthz") == (200, "healthy\n")

    run(work)


def test_health_in_lock_step() -> None:
    """Waiting for a simulator is healthy, for hours; waiting for itself is not."""

    async def work() -> None:
        hands = Hands()
        vitals = Vitals("lockstep", hands)
        vitals.announce()
        async with visiting(vitals) as visitor:
            hands.now_s += 3600.0
            assert (await visitor.get("/healthz"))[:2] == (200, "healthy\n")
            assert (await visitor.get("/readyz"))[:2] == (200, "ready\n")
            vitals.cycle_begun()
            hands.now_s += 9.0
            assert (await visitor.get("/healthz")).status == 200
            hands.now_s += 2.0
            answer = await visitor.get("/healthz")
            assert answer[:2] == (503, "a control cycle has been under way for 11.0 s\n")

    run(work)


def test_the_front_page_and_what_is_not_there() -> None:
    async def work() -> None:
        async with visiting(Vitals("wall")) as visitor:
            answer = await visitor.get("/")
            assert (answer.status, answer.text.count("\n")) == (200, 1)
            assert OPTIONS.map.intersection in answer.text
            assert (await visitor.get("/admin")).status == 404

    run(work)


@contextmanager
def taken() -> Any:
    """A port of this machine that somebody listens on."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


@pytest.mark.parametrize("loop", LOOPS)
def test_a_taken_port_is_refused_where_it_was_asked_for_and_done_without_where_not(loop: Callable[[], Any]) -> None:
    async def work() -> None:
        with taken() as port:
            with pytest.raises(StartError) as caught:
                async with server.opened(Address("127.0.0.1", port), OPTIONS, Vitals("wall"), Hub(OPTIONS, 1)):
                    pass
            assert str(caught.value) == f"--http 127.0.0.1:{port}: Address already in use"
            spare = Address("127.0.0.1", port, required=False)
            async with server.opened(spare, OPTIONS, Vitals("wall"), Hub(OPTIONS, 1)) as url:
                assert url is None

    run(work, loop)


@pytest.mark.parametrize("host", ["nowhere.invalid", "a..b"])
def test_a_host_that_is_none_is_one_line(host: str) -> None:
    async def work() -> None:
        with pytest.raises(StartError) as caught:
            async with server.opened(Address(host, 8080), OPTIONS, Vitals("wall"), Hub(OPTIONS, 1)):
                pass
        message = str(caught.value)
        assert message.startswith(f"--http {host}:8080: ")
        assert "\n" not in message

    run(work)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        (None, address.DEFAULT),
        ("off", None),
        ("none", None),
        ("127.0.0.1:8080", Address("127.0.0.1", 8080)),
        ("0.0.0.0:0", Address("0.0.0.0", 0)),
        ("manager.local:65535", Address("manager.local", 65535)),
        ("[::1]:8080", Address("::1", 8080)),
    ],
)
def test_addresses(text: str | None, meant: Address | None) -> None:
    assert address.parse(text) == meant
    if text and meant:
        assert str(meant) == text


@pytest.mark.parametrize(
    "text",
    ["", "8080", ":8080", "localhost", "localhost:", "localhost:http", "h:65536", "h:-1", "::1:8080", "[::1", "h:1/x",
     "u@h:1", "http://h:1", "on"],
)  # fmt: skip
def test_what_is_no_address_is_refused_in_words(text: str) -> None:
    with pytest.raises(ValueError, match="allowed: HOST:PORT such as") as caught:
        address.parse(text)
    assert str(caught.value).startswith(f"{text!r}; ")


def test_by_default_only_this_machine_is_served() -> None:
    assert Address("127.0.0.1", 8080, required=False) == address.DEFAULT
