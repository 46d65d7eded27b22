"""Several fleets on one road: nobody begins a step before all have ended the last one."""

from __future__ import annotations

import asyncio


class Together:
    """A gate that opens once everybody who is still there has come to it."""

    def __init__(self, parties: int) -> None:
        self._parties = parties
        self._waiting = 0
        self._gate = asyncio.Event()

    async def all_here(self) -> None:
        """Wait for the others."""
        gate = self._gate
        self._waiting += 1
        self._open_if_complete()
        await gate.wait()

    def leave(self) -> None:
        """One less to wait for."""
        self._parties -= 1
        self._open_if_complete()

    def _open_if_complete(self) -> None:
        if self._waiting >= self._parties:
            self._gate.set()
            self._waiting, self._gate = 0, asyncio.Event()
