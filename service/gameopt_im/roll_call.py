"""Who has still to be heard before a control cycle need not wait any longer."""

from __future__ import annotations

import asyncio
from collections.abc import Collection


class RollCall:
    """Keys that are waited for on the event loop, and crossed out by the threads that messages come on."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._call: tuple[set[str], asyncio.Event] | None = None

    async def heard_all(self, whom: Collection[str], most_s: float) -> bool:
        """Returns once all of these keys have been crossed out, or False after `most_s`.

        What was crossed out before the call does not count.
        """
        complete = asyncio.Event()
        self._call = set(whom), complete
        try:
            async with asyncio.timeout(most_s):
                await complete.wait()
        except TimeoutError:
            return False
        finally:
            self._call = None
        return True

    def heard(self, key: str) -> None:
        """Cross one out, whether it is waited for or not; from any thread."""
        call = self._call
        if call is None:
            return
        awaited, complete = call  # of one call: another may begin meanwhile, which is not told
        if key in awaited:
            awaited.discard(key)
            if not awaited:
                self._loop.call_soon_threadsafe(complete.set)
