"""Who has still to be heard before a control cycle need not wait any longer."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field


@dataclass(slots=True)
class _Call:
    """`awaited` keys are heard from `since_s` on; `ended_s` is when none was left, None before."""

    awaited: set[str] = field(default_factory=set)
    since_s: float = 0.0
    complete: asyncio.Event = field(default_factory=asyncio.Event)
    ended_s: float | None = None


class RollCall:
    """Keys that are waited for on the event loop, and crossed out by the threads that messages come on."""

    def __init__(self, loop: asyncio.AbstractEventLoop, now: Callable[[], float] = time.time) -> None:
        self._loop = loop
        self._now = now
        self._call = _Call()

    @property
    def ended_s(self) -> float | None:
        """When the last one waited for was heard, on the clock of `time.perf_counter`; None while one is missing.

        Not before the time from which it is heard at all, should everybody be gone by then.
        """
        return self._call.ended_s

    def begin(self, whom: Collection[str], since_s: float) -> None:
        """Waits for these keys from now on, and for no others; what is heard before `since_s` does not count."""
        self._call = _Call(set(whom), since_s)

    async def complete(self, most_s: float) -> bool:
        """Returns once all keys have been crossed out, or False after `most_s`."""
        try:
            async with asyncio.timeout(most_s):
                await self._call.complete.wait()
        except TimeoutError:
            return False
        return True

    def heard(self, key: str) -> None:
        """Cross one out, whether it is waited for or not; from any thread."""
        call = self._call  # one call: another may begin meanwhile, which is not told
        if self._now() >= call.since_s:
            self._cross_out(key, call)

    def gone(self, key: str) -> None:
        """As `heard`, at any time: whoever has left will not speak again."""
        self._cross_out(key, self._call)

    def _cross_out(self, key: str, call: _Call) -> None:
        if key in call.awaited:
            call.awaited.discard(key)
            if not call.awaited:
                call.ended_s = time.perf_counter() + max(0.0, call.since_s - self._now())
                self._loop.call_soon_threadsafe(call.complete.set)
