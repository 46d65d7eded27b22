"""Who has still to be heard before a control cycle need not wait any longer."""

from __future__ import annotations

import asyncio
from collections.abc import Collection


class RollCall:
    """Keys that are waited for on the event loop, and crossed out by the threads that messages come on."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._complete = asyncio.Event()
        self._awaited: set[str] = set()

    async def heard_all(self, whom: Collection[str], most_s: float) -> bool:
        """Returns once all of these keys have been crossed out, or False after `most_s`.

        What was crossed out before the call does not count.
        """
        self._complete.clear()
        self._awaited = set(whom)
        try:
            async with asyncio.timeout(most_s):
                await self._complete.wait()
        except TimeoutError:
            return False
        finally:
            self._awaited = set()
        return True

    def heard(self, key: str) -> None:
        """Cross one out, whether it is waited for or not; from any thread."""
        awaited = self._awaited  # another call may begin meanwhile: then this one comes to nothing
        if key in awaited:
            awaited.discard(key)
            if not awaited:
                self._loop.call_soon_threadsafe(self._complete.set)
