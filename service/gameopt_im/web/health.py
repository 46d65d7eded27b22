"""`/healthz` and `/readyz`: 200 or 503, and why in one line."""

from __future__ import annotations

from aiohttp import web

from gameopt_im.vitals import Vitals


def routes(vitals: Vitals) -> list[web.RouteDef]:
    """Whether to restart the manager, and whether to send it vehicles."""

    async def healthz(_: web.Request) -> web.Response:
        return _answer(vitals.ailment(), "healthy" if vitals.announced else "starting")

    async def readyz(_: web.Request) -> web.Response:
        return _answer(vitals.ailment() if vitals.announced else "warming up", "ready")

    return [web.get("/healthz", healthz), web.get("/readyz", readyz)]


def _answer(wrong: str | None, right: str) -> web.Response:
    return web.Response(status=200 if wrong is None else 503, text=f"{wrong or right}\n")
