"""`/`: the live page for a browser, for anybody else one line that says which manager this is, and where to look."""

from __future__ import annotations

from importlib.resources import files

from aiohttp import web

from gameopt_im.options import ServeOptions

KINDS = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "svg": "image/svg+xml",
}
PAGE = "index.html"
HEADERS = {
    "Cache-Control": "no-cache",  # a manager of another version may be at the same address tomorrow
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Vary": "Accept",
}


def static_files() -> dict[str, tuple[bytes, str]]:
    """The files of the live page by name: their bytes and their content types."""
    folder = files("gameopt_im.web") / "static"
    found = {}
    for file in folder.iterdir():
        kind = KINDS.get(file.name.rpartition(".")[2])
        if kind is not None:
            found[file.name] = (file.read_bytes(), kind)
    return found


def routes(options: ServeOptions) -> list[web.RouteDef]:
    """The page and its files, read once."""
    line = f"gameopt-im, intersection {options.map.intersection}: /metrics /healthz /readyz\n"
    served = static_files()

    def answer(name: str) -> web.Response:
        body, kind = served[name]
        return web.Response(body=body, content_type=kind, charset="utf-8", headers=HEADERS)

    async def front(request: web.Request) -> web.Response:
        if "text/html" in request.headers.get("Accept", ""):
            return answer(PAGE)
        return web.Response(text=line, headers={"Vary": "Accept"})

    async def file(request: web.Request) -> web.Response:
        name = request.match_info["name"]
        if name not in served:
            raise web.HTTPNotFound
        return answer(name)

    return [web.get("/", front), web.get("/static/{name}", file)]
