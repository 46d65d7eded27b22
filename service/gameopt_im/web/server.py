"""The web server, on the manager's own event loop: opened with the manager, closed with it.

A page is a module with `routes(…)`; `application` puts them together.
"""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import structlog
from aiohttp import web

from gameopt_im.options import ServeOptions, StartError
from gameopt_im.vitals import Vitals
from gameopt_im.web import front, health, live, metrics
from gameopt_im.web.address import Address
from gameopt_im.web.hub import Hub

log = structlog.get_logger()

SHUTDOWN_S = 1.0
"""Longest wait for answers under way when the manager ends."""


def application(options: ServeOptions, vitals: Vitals, hub: Hub) -> web.Application:
    """Everything that is served."""
    served = web.Application()
    served.add_routes(
        [*front.routes(options), *health.routes(vitals), *metrics.routes(options, vitals), *live.routes(hub)]
    )

    async def send_viewers_away(_: web.Application) -> None:
        hub.close()

    served.on_shutdown.append(send_viewers_away)
    return served


@asynccontextmanager
async def opened(address: Address, options: ServeOptions, vitals: Vitals, hub: Hub) -> AsyncIterator[str | None]:
    """The server's URL, while it serves; None where the default address is taken, which is only worth a warning.

    Raises `StartError` where an address that was asked for cannot be had.
    """
    runner = web.AppRunner(application(options, vitals, hub), access_log=None, shutdown_timeout=SHUTDOWN_S)
    await runner.setup()
    try:
        yield await _listen(runner, address)
    finally:
        await runner.cleanup()


async def _listen(runner: web.AppRunner, address: Address) -> str | None:
    try:
        await web.TCPSite(runner, address.host, address.port).start()
    except (OSError, UnicodeError) as error:
        why = _reason(error)
        if address.required:
            raise StartError(f"--http {address}: {why}") from None
        log.warning("no web server", address=str(address), why=why)
        return None
    url = f"http://{Address(*runner.addresses[0][:2])}"  # port 0 is a real one by now
    log.info("web server", url=url)
    return url


def _reason(error: OSError | UnicodeError) -> str:
    """The system's own words, without the address that a loop puts round them."""
    if not isinstance(error, OSError):
        return "not the name of a host"
    known = error.errno is not None and error.errno > 0
    return os.strerror(error.errno or 0) if known else error.strerror or str(error)
