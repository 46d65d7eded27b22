"""`/live`: the WebSocket behind the live page. Frames go out; all that comes in is which vehicle a viewer selects."""

from __future__ import annotations

import asyncio
import contextlib
from urllib.parse import urlsplit

import msgspec
from aiohttp import WSMsgType, web

from gameopt_im.web.hub import CrowdedError, Hub, Viewer
from gameopt_wire.messages import VehicleId

HEARTBEAT_S = 20.0
"""A viewer that does not answer a ping for this long is gone."""
MOST_BYTES = 1024
"""Of a message from a viewer; a longer one ends the connection."""


class Select(msgspec.Struct, frozen=True, tag_field="type", tag="select"):
    """A viewer wants details of this vehicle, or of none."""

    vehicle: VehicleId | None


_SELECT = msgspec.json.Decoder(Select)


def listen(viewer: Viewer, text: str) -> None:
    """Takes in what a viewer's page says; what is no selection is ignored."""
    with contextlib.suppress(msgspec.DecodeError, UnicodeEncodeError):
        viewer.selected = _SELECT.decode(text).vehicle


def routes(hub: Hub) -> list[web.RouteDef]:
    """The WebSocket."""

    async def watch(request: web.Request) -> web.StreamResponse:
        if not _from_here(request):
            raise web.HTTPForbidden(text="the live page of another site\n")
        try:
            with hub.viewing() as viewer:
                return await _watch(request, hub, viewer)
        except CrowdedError:
            raise web.HTTPServiceUnavailable(text="too many viewers\n") from None

    return [web.get("/live", watch)]


def _from_here(request: web.Request) -> bool:
    """Browsers let any site open a WebSocket to any address: only pages that came from this one may."""
    origin = request.headers.get("Origin")
    return origin is None or urlsplit(origin).netloc == request.host


async def _watch(request: web.Request, hub: Hub, viewer: Viewer) -> web.StreamResponse:
    socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MOST_BYTES, compress=False)
    await socket.prepare(request)
    sending = asyncio.create_task(_send(socket, hub, viewer))
    try:
        async for message in socket:
            if message.type is WSMsgType.TEXT:
                listen(viewer, message.data)
    finally:
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending
    return socket


async def _send(socket: web.WebSocketResponse, hub: Hub, viewer: Viewer) -> None:
    """Frames as fast as the viewer reads them: what is sent waits for its connection, never a frame for it."""
    with contextlib.suppress(ConnectionError):
        await socket.send_str(hub.hello().decode())
        while (frame := await viewer.take()) is not None:
            await socket.send_str(frame.decode())
        await socket.close(code=1001, message=b"the manager ends")
