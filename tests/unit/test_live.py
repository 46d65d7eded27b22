"""Who watches the live page: newest frame or none, never waited for; and what is served, over real HTTP."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import socket
from collections.abc import Callable, Coroutine
from typing import Any

import aiohttp
import msgspec
import pytest
import uvloop
from watched import options, watch

from gameopt_im.manager import Outcome
from gameopt_im.sight import Sight
from gameopt_im.vitals import Vitals
from gameopt_im.web import frames, front, hub, live, server
from gameopt_im.web.address import Address
from gameopt_im.web.hub import LEAST_GAP_S, MOST_VIEWERS, CrowdedError, Hub, Viewer

OPTIONS = options()
PATIENCE_S = 10.0


@pytest.fixture(scope="module")
def shown() -> tuple[Outcome, Sight]:
    """A control cycle with traffic."""
    last: list[tuple[Outcome, Sight]] = []
    watch(OPTIONS, 30, lambda outcome, sight: last.append((outcome, sight)))
    return last[-1]


class Hands:
    """A monotonic clock turned by hand."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def run(work: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work()

    with asyncio.Runner(debug=True, loop_factory=uvloop.new_event_loop) as runner:
        runner.run(bounded())


def cycle_of(frame: bytes | None) -> int:
    assert frame is not None
    return int(json.loads(frame)["cycle"])


def later(outcome: Outcome, cycle: int) -> Outcome:
    return dataclasses.replace(outcome, report=msgspec.structs.replace(outcome.report, cycle=cycle))


def test_a_viewer_that_is_slow_gets_the_newest_frame_and_the_others_get_all(shown: tuple[Outcome, Sight]) -> None:
    async def work() -> None:
        hands = Hands()
        showing = Hub(OPTIONS, 1, hands)
        outcome, sight = shown
        with showing.viewing() as slow, showing.viewing() as quick:
            got = []
            for cycle in range(5):
                hands.now_s += 0.1
                showing.cycle_done(later(outcome, cycle), sight)
                got.append(cycle_of(await quick.take()))
            assert got == [0, 1, 2, 3, 4]
            assert cycle_of(await slow.take()) == 4
            assert (slow.skipped, quick.skipped) == (4, 0)

    run(work)


def test_nothing_is_made_while_nobody_watches(shown: tuple[Outcome, Sight], monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(hub, "frame_of", lambda *given: made.append(given) or frames.frame_of(*given))
    hands = Hands()
    showing = Hub(OPTIONS, 1, hands)
    showing.cycle_done(*shown)
    with showing.viewing():
        hands.now_s += 0.1
        showing.cycle_done(*shown)
        assert len(made) == 1
    hands.now_s += 0.1
    showing.cycle_done(*shown)
    assert len(made) == 1


def test_a_frame_is_made_once_for_all_and_no_more_often_than_can_be_seen(
    shown: tuple[Outcome, Sight], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    monkeypatch.setattr(hub, "frame_of", lambda *given: made.append(given) or frames.frame_of(*given))
    hands = Hands()
    showing = Hub(OPTIONS, 1, hands)
    with showing.viewing(), showing.viewing(), showing.viewing():
        for _ in range(10):
            showing.cycle_done(*shown)
            hands.now_s += 0.26 * LEAST_GAP_S
    assert len(made) == 3  # at 0, 4 and 8 quarters of the gap and a bit


def test_details_are_of_what_any_viewer_has_selected(shown: tuple[Outcome, Sight]) -> None:
    async def work() -> None:
        showing = Hub(OPTIONS, 1)
        first, second = shown[1].snapshot.ids[:2]
        with showing.viewing() as one, showing.viewing() as other:
            one.selected, other.selected = first, second
            showing.cycle_done(*shown)
            frame = json.loads(await one.take() or b"")
            assert set(frame["details"]) == {first, second}

    run(work)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "7", '{"type":"select"}', '{"type":"stop","vehicle":"a"}',
             '{"type":"select","vehicle":3}', '{"type":"select","vehicle":""}',
             '{"type":"select","vehicle":"' + 65 * "a" + '"}', "\ud800"],
)  # fmt: skip
def test_odd_messages_are_ignored(text: str) -> None:
    viewer = Viewer()
    live.listen(viewer, '{"type":"select","vehicle":"a"}')
    live.listen(viewer, text)
    assert viewer.selected == "a"
    live.listen(viewer, '{"type":"select","vehicle":null}')
    assert viewer.selected is None


def test_a_frame_that_cannot_be_made_ends_the_watching_and_not_the_managing(shown: tuple[Outcome, Sight]) -> None:
    async def work() -> None:
        showing = Hub(OPTIONS, 1)
        outcome, sight = shown
        with showing.viewing() as viewer:
            showing.cycle_done(outcome, sight._replace(tracked=None))  # type: ignore[arg-type]
            assert await viewer.take() is None

    run(work)


def test_so_many_may_watch_and_no_more() -> None:
    showing = Hub(OPTIONS, 1)
    watching = [showing.viewing() for _ in range(MOST_VIEWERS)]
    for each in watching:
        each.__enter__()
    with pytest.raises(CrowdedError), showing.viewing():
        pass
    watching[0].__exit__(None, None, None)
    with showing.viewing():
        pass


class Served:
    """A web server with its hub, and a client."""

    async def __aenter__(self) -> Served:
        self._hands = Hands()
        self.hub = Hub(OPTIONS, 1, self._hands)
        self._opened = server.opened(Address("127.0.0.1", 0), OPTIONS, Vitals("wall"), self.hub)
        self.url = await self._opened.__aenter__()
        self.session = aiohttp.ClientSession()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.session.close()
        await self.end()

    def show(self, outcome: Outcome, sight: Sight) -> None:
        """A control cycle later."""
        self._hands.now_s += 0.1
        self.hub.cycle_done(outcome, sight)

    async def deaf_viewer(self) -> asyncio.StreamWriter:
        """Somebody who opens a WebSocket and reads no further than the answer."""
        host, port = self.url.removeprefix("http://").split(":")
        connection = socket.create_connection((host, int(port)))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        reader, writer = await asyncio.open_connection(sock=connection, limit=4096)
        asking = "GET /live HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade"
        key = "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", ""
        writer.write("\r\n".join(asking + key).encode())
        assert b" 101 " in await reader.readline()
        return writer

    async def end(self) -> None:
        if self._opened is not None:
            opened, self._opened = self._opened, None
            await opened.__aexit__(None, None, None)


def test_a_viewer_hears_hello_then_frames_and_may_select(shown: tuple[Outcome, Sight]) -> None:
    async def work() -> None:
        async with Served() as served, served.session.ws_connect(f"{served.url}/live") as page:
            assert (await page.receive_json())["type"] == "hello"
            await page.send_str("odd")
            await page.send_bytes(b"\x00")
            vehicle = shown[1].snapshot.ids[0]
            await page.send_str(json.dumps({"type": "select", "vehicle": vehicle}))
            frame: dict[str, Any] = {"details": {}}
            while not frame["details"]:
                served.show(*shown)
                frame = await page.receive_json()
            assert list(frame["details"]) == [vehicle]
            await served.end()
            last = await page.receive()
            assert (last.type, last.data) == (aiohttp.WSMsgType.CLOSE, 1001)

    run(work)


def test_a_viewer_that_does_not_read_keeps_nobody_waiting(shown: tuple[Outcome, Sight]) -> None:
    async def work() -> None:
        async with Served() as served, served.session.ws_connect(f"{served.url}/live") as page:
            assert (await page.receive_json())["type"] == "hello"
            writer = await served.deaf_viewer()
            long_report = msgspec.structs.replace(shown[0].report, stages_ms={f"stage {k}": 1.0 for k in range(5000)})
            big = dataclasses.replace(shown[0], report=long_report)  # what the system buffers is soon full
            cycle = 0
            while not any(viewer.skipped for viewer in served.hub._viewers):
                cycle += 1
                served.show(later(big, cycle), shown[1])
                assert (await page.receive_json())["cycle"] == cycle
            writer.close()

    run(work)


@pytest.mark.parametrize("origin", ["https://elsewhere.example", "null", "http://127.0.0.1:1"])
def test_the_pages_of_other_sites_may_not_watch(origin: str) -> None:
    async def work() -> None:
        async with Served() as served:
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await served.session.ws_connect(f"{served.url}/live", headers={"Origin": origin})
            assert caught.value.status == 403
            async with served.session.ws_connect(f"{served.url}/live", headers={"Origin": served.url}) as page:
                assert (await page.receive_json())["type"] == "hello"

    run(work)


def test_the_page_and_its_files_are_served_and_name_nothing_outside() -> None:
    async def work() -> None:
        async with Served() as served:
            async with served.session.get(served.url, headers={"Accept": "text/html,*/*"}) as answer:
                page = await answer.text()
                assert (answer.status, answer.content_type) == (200, "text/html")
                assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
            for name, (_, kind) in front.static_files().items():
                async with served.session.get(f"{served.url}/static/{name}") as answer:
                    assert (answer.status, answer.content_type) == (200, kind)
                    text = await answer.text()
                    assert "https://" not in text
                    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
            assert "/static/main.js" in page
            for name in ("none.js", "..%2Ffront.py", "__init__.py"):
                async with served.session.get(f"{served.url}/static/{name}") as answer:
                    assert answer.status == 404

    run(work)
