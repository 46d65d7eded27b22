"""Who has still to be heard before a control cycle need not wait any longer."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Collection


class RollCall:
    """Keys that are waited for on the event loop, and crossed out by the threads that messages come on."""

    def __init__(self, loop: asyncio.AbstractEventLoop, now: Callable[[], float] = time.time) -> None:
        self._loop = loop
        self._now = now
        self._call: tuple[set[str], float, asyncio.Event] = set(), 0.0, asyncio.Event()

    def begin(self, whom: Collection[str], since_s: float) -> None:
        """Waits for these keys from now on, and for no others; what is heard before `since_s` does not count."""
        self._call = set(whom), since_s, asyncio.Event()

    async def complete(self, most_s: float) -> bool:
        """Returns once all keys have been crossed out, or False after `most_s`."""
        _, _, complete = self._call
        try:
            async with asyncio.timeout(most_s):
                await complete.wait()
        except TimeoutError:
            return False
        return True

    def heard(self, key: str) -> None:
        """Cross one out, whether it is waited for or not; from any thread."""
        call = self._call  # one call: another may begin meanwhile, which is not told
        if self._now() >= call[1]:
            self._cross_out(key, call)

    def gone(self, key: str) -> None:
        """As `heard`, at any time: whoever has left will not speak again."""
        self._cross_out(key, self._call)

    def _cross_out(self, key: str, call: tuple[set[str], float, asyncio.Event]) -> None:
        awaited, _, complete = call
        if key in awaited:
            awaited.discard(key)
            if not awaited:
                self._loop.call_soon_threadsafe(complete.set)
