"""`/`: which manager this is, and where to look."""

from __future__ import annotations

from aiohttp import web

from gameopt_im.options import ServeOptions


def routes(options: ServeOptions) -> list[web.RouteDef]:
    """One line to read."""
    line = f"gameopt-im, intersection {options.map.intersection}: /metrics /healthz /readyz\n"

    async def front(_: web.Request) -> web.Response:
        return web.Response(text=line)

    return [web.get("/", front)]
