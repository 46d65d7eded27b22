"""The live page in a real browser, on a real manager with real vehicle processes, at the wall clock.

Nothing sleeps to synchronise: every step waits until the page shows something. With GAMEOPT_SCREENSHOTS set to a
folder, the pictures of the documentation are written there.
"""

from __future__ import annotations

import os
import re
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import browser
from playwright.async_api import Browser, Page, async_playwright, expect
from processes import Running, free_endpoint, manager, run

LAPTOP = {"width": 1360, "height": 880}
PHONE = {"width": 390, "height": 844}
PATIENCE_MS = 30_000
PICTURES = os.environ.get("GAMEOPT_SCREENSHOTS")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Junction:
    """A manager with its web server, and vehicles; both can be started anew."""

    def __init__(self) -> None:
        self.endpoint, self.port = free_endpoint(), free_port()
        self.url = f"http://127.0.0.1:{self.port}/"

    def manager(self) -> Any:
        arguments = ("--http", f"127.0.0.1:{self.port}", "--workers", 0)
        return manager(*arguments, endpoint=self.endpoint, clock="wall")

    @asynccontextmanager
    async def vehicles(self, count: int) -> AsyncIterator[Running]:
        driven = await Running.start("gameopt_vehicles", "--synthetic", count, "--connect", self.endpoint)
        try:
            yield driven
        finally:
            await driven.stop()


@asynccontextmanager
async def chromium() -> AsyncIterator[Browser]:
    async with async_playwright() as playwright:
        executable = browser.found(playwright.chromium.executable_path)
        launched = await playwright.chromium.launch(executable_path=executable, args=[*browser.ARGUMENTS])
        try:
            yield launched
        finally:
            await launched.close()


async def opened(where: Browser, url: str, complaints: list[str], **look: Any) -> Page:
    """The page, complaining about whatever it asks of anybody but the manager, and about every error."""
    page = await where.new_page(**look)
    page.set_default_timeout(PATIENCE_MS)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: request.url.startswith(url) or complaints.append(request.url))
    await page.goto(url)
    await page.wait_for_selector("#order li")
    return page


async def picture(page: Page, name: str) -> None:
    if PICTURES:
        await page.evaluate("document.activeElement.blur()")
        await page.screenshot(path=Path(PICTURES) / f"{name}.png")


async def moves(page: Page) -> None:
    """Waits for some vehicle to be drawn at two places more than 3 pixels apart."""
    await page.wait_for_function(
        """() => {
            const seen = (window.seen ??= new Map());
            return window.gameopt.places().some(({ vehicle, x, y }) => {
                const [x0, y0] = seen.get(vehicle) ?? seen.set(vehicle, [x, y]).get(vehicle);
                return Math.hypot(x - x0, y - y0) > 3;
            });
        }"""
    )


async def click_a_vehicle(page: Page) -> str:
    """Clicks on one that is slow and near to no other; the vehicle that should be selected.

    A click on a busy machine comes up to a second after the place was read.
    """
    spot = await (
        await page.wait_for_function(
            """() => {
                const places = window.gameopt.places();
                const alone = ({ vehicle, x, y }) =>
                    places.every((other) => other.vehicle === vehicle || Math.hypot(other.x - x, other.y - y) > 30);
                const inside = ({ x, y }) => x > 40 && y > 40 && x < 700 && y < 400;
                return places.filter(inside).find((place) => place.speed_mps < 5 && alone(place));
            }"""
        )
    ).json_value()
    box = await page.locator("#junction").bounding_box()
    assert box
    await page.mouse.click(box["x"] + spot["x"], box["y"] + spot["y"])
    return str(spot["vehicle"])


def test_it_loads_vehicles_move_and_one_is_selected_by_click_and_by_keyboard() -> None:
    async def scenario() -> None:
        junction, complaints = Junction(), list[str]()
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(junction.manager())
            await stack.enter_async_context(junction.vehicles(70))
            window = await stack.enter_async_context(chromium())
            page = await opened(window, junction.url, complaints, viewport=LAPTOP)
            await expect(page.locator("#link")).to_have_text("live")
            await moves(page)

            card = page.locator("#selected")
            clicked = await click_a_vehicle(page)
            await expect(card).to_have_attribute("data-vehicle", clicked)
            await expect(card.locator("dl")).to_contain_text("to the line")

            await page.focus("#order")
            await page.keyboard.press("End")  # the first in the order may have crossed before it is looked for
            last = await page.locator("#order li[aria-selected=true]").get_attribute("data-vehicle")
            await expect(card).to_have_attribute("data-vehicle", last or "")
            await page.keyboard.press("Escape")
            await expect(card.locator(".hint")).to_be_visible()

            await page.focus("#junction")
            await page.keyboard.press("End")
            await expect(card.locator(".bids li.won")).to_have_count(1)
            await expect(page.locator("#candidates tr.won")).to_have_count(1)
            await expect(page.locator("#why")).to_contain_text("won")
            await page.wait_for_function("() => document.querySelector('#chart-throughput b').textContent > 0")
            await page.keyboard.press("End")
            await picture(page, "live-page")
            await page.close()

            dark = await opened(window, junction.url, complaints, viewport=LAPTOP, color_scheme="dark")
            await moves(dark)
            await dark.wait_for_function("() => document.querySelector('#chart-throughput b').textContent > 0")
            await dark.focus("#order")
            await dark.keyboard.press("End")
            await expect(dark.locator("#selected .bids li").first).to_be_visible()
            await picture(dark, "live-page-dark")
            await dark.close()

            phone = await opened(
                window, junction.url, complaints, viewport=PHONE, device_scale_factor=2, has_touch=True
            )
            await moves(phone)
            assert await phone.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
            await phone.locator("#order li").first.tap()
            await expect(phone.locator("#selected .body")).to_be_visible()
            await phone.evaluate("scrollTo(0, 0)")
            await picture(phone, "live-page-phone")
        assert complaints == []

    run(scenario)


def test_the_banner_tells_of_silent_vehicles_and_the_page_comes_back_after_a_restart() -> None:
    async def scenario() -> None:
        junction, complaints = Junction(), list[str]()
        async with AsyncExitStack() as stack:
            window = await stack.enter_async_context(chromium())
            async with junction.manager(), junction.vehicles(12) as driven:
                page = await opened(window, junction.url, complaints, viewport=LAPTOP)
                await moves(page)
                term = await page.evaluate("document.documentElement.dataset.term")
                driven.signal(signal.SIGKILL)
                await expect(page.locator("#banner")).to_contain_text("silent", timeout=PATIENCE_MS)
                await driven.ended()
            await expect(page.locator("#banner")).to_contain_text("No connection", timeout=PATIENCE_MS)
            await expect(page.locator("#link")).to_have_text("reconnecting")
            async with junction.manager(), junction.vehicles(12):
                await expect(page.locator("#link")).to_have_text("live", timeout=PATIENCE_MS)
                await page.wait_for_function("term => document.documentElement.dataset.term !== term", arg=term)
                await expect(page.locator("#banner")).not_to_contain_text("No connection")
                await page.evaluate("window.seen = new Map()")
                await moves(page)
        # A lost connection is said by the browser, not by the page.
        assert [each for each in complaints if not re.search("WebSocket", each)] == []

    run(scenario)
