"""A manager process that is scraped while vehicles drive, at the wall clock."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import aiohttp
import pytest
from processes import Observer, Running, command, free_endpoint, manager, run
from prometheus_client.parser import text_string_to_metric_families

from gameopt_im.web.address import DEFAULT

pytestmark = pytest.mark.processes

ANY_PORT = "127.0.0.1:0"


async def url_of(serving: Running) -> str:
    """Where the manager says that its web server is."""
    return re.findall(r"http://[^\s\"]+", await serving.said("web server"))[0]


async def scrape(session: aiohttp.ClientSession, url: str) -> tuple[dict[str, float], set[str]]:
    """Samples without labels by name, and every value of a label."""
    async with session.get(f"{url}/metrics") as answer:
        families = list(text_string_to_metric_families(await answer.text()))
    samples = [sample for family in families for sample in family.samples]
    plain = {sample.name: sample.value for sample in samples if not sample.labels}
    return plain, {value for sample in samples for value in sample.labels.values()}


def test_a_scrape_tells_what_happened() -> None:
    async def scenario() -> None:
        endpoint = free_endpoint()
        async with aiohttp.ClientSession() as session:  # still open when the manager ends
            async with manager("--http", ANY_PORT, endpoint=endpoint, clock="wall") as serving:
                url = await url_of(serving)
                async with Observer(endpoint) as observer:
                    await observer.until(lambda report: report.vehicles == 0)
                    first, _ = await scrape(session, url)
                    assert (first["gameopt_ready"], first["gameopt_bids_total"]) == (1, 0)
                    driving = ("--synthetic", 16, "--connect", endpoint, "--duration", 6)
                    driven = await Running.start("gameopt_vehicles", *driving)
                    await observer.until(lambda report: report.cleared > 2)
                    during, labels = await scrape(session, url)
                    for path in ("/healthz", "/readyz"):
                        async with session.get(url + path) as answer:
                            assert answer.status == 200
                    assert (await driven.ended()).code == 0
                    last = await observer.until(lambda report: report.silent == report.vehicles)
                    heard = list(observer.reports)
                    after, _ = await scrape(session, url)
                names = {key.rsplit("/", 1)[1] for key, _ in observer.messages("state")}
            assert 2 < during["gameopt_vehicles_cleared"] < during["gameopt_vehicles"] <= len(names)
            assert not names & labels
            assert after["gameopt_received_messages_total"] == last.received_total > 0
            assert after["gameopt_bids_total"] >= 16
            # The manager has counted all that its reports tell, and has gone on since.
            at_least = {
                "control_cycles": len(heard),
                "missed_control_cycles": last.missed_total,
                "commands": sum(report.commands for report in heard),
                "grants": sum(len(report.granted) for report in heard),
                "refusals": sum(report.refused for report in heard),
                "candidates": sum(report.candidates for report in heard),
            }
            assert {name for name in at_least if after[f"gameopt_{name}_total"] < at_least[name]} == set()
            assert 0 < during["gameopt_grants_total"] <= after["gameopt_grants_total"]
            assert after["gameopt_control_cycle_seconds_count"] == after["gameopt_control_cycles_total"]
        assert "Traceback" not in (ended := await serving.ended()).err
        assert "Warning" not in ended.err

    run(scenario)


@contextmanager
def occupied(host: str, port: int) -> Iterator[int]:
    """A port that somebody listens on: we, unless it is somebody else already."""
    with socket.socket() as other:
        with contextlib.suppress(OSError):
            other.bind((host, port))
            other.listen()
        yield other.getsockname()[1] or port


def test_a_port_that_was_asked_for_and_is_taken_ends_it_at_once() -> None:
    async def scenario() -> None:
        with occupied("127.0.0.1", 0) as port:
            ended = await command("gameopt_im", "serve", "--listen", free_endpoint(), "--http", f"127.0.0.1:{port}")
        assert (ended.code, ended.out) == (2, "")
        assert ended.err == f"gameopt-im: --http 127.0.0.1:{port}: Address already in use\n"

    run(scenario)


def test_a_default_port_that_is_taken_is_done_without_and_logs_are_json() -> None:
    async def scenario() -> None:
        with occupied(DEFAULT.host, DEFAULT.port):
            arguments = ("--listen", free_endpoint(), "--workers", 0, "--log-format", "json")
            serving = await Running.start("gameopt_im", "serve", *arguments)
            await serving.said('"serving"')
            ended = await serving.stop()
        assert ended.code == 0
        said = [json.loads(line) for line in ended.err.splitlines()]
        assert all({"time", "level", "event"} <= set(line) for line in said)
        (warning,) = [line for line in said if line["level"] == "warning"]
        assert (warning["event"], warning["address"]) == ("no web server", str(DEFAULT))
        assert warning["why"] == "Address already in use"

    run(scenario)


def test_a_request_under_way_does_not_keep_the_manager_from_ending() -> None:
    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager("--http", ANY_PORT, "--workers", 0, endpoint=endpoint) as serving:
            host, port = (await url_of(serving)).removeprefix("http://").split(":")
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(b"GET /metrics HTTP/1.1\r\n")  # and never the rest of it
            await writer.drain()
        assert await reader.read() == b""
        writer.close()
        await writer.wait_closed()

    run(scenario)
