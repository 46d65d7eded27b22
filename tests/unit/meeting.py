"""Where the tests of the manager's bus meet it: a real endpoint of this machine."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from gameopt_im.bus import Bus, configuration

HERE = "cross/roads"
CHARTER = b"the charter, prebuilt"
PATIENCE_S = 10.0
"""Nothing takes this long; a test that would otherwise hang fails instead."""


def run(work: Coroutine[Any, Any, None]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work

    asyncio.run(bounded(), debug=True)


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@asynccontextmanager
async def hub(endpoint: str) -> AsyncIterator[Bus]:
    async with await Bus.open(HERE, configuration(listen=[endpoint]), CHARTER) as bus:
        yield bus
