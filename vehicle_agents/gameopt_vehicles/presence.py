"""Which vehicles are there, as liveliness tokens, on sessions that are relieved before they hold too much.

Both ends of a Zenoh session number the key of every token declared on it, and hold it until the session is
closed: 1.5 kB for each at the hub, 1 kB here. A vehicle with a session of its own takes all of it along when it
leaves. Here one process speaks for thousands of vehicles, one after the other: a session that has declared enough
is relieved by a new one, and closed when its last vehicle has left.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import zenoh

from gameopt_wire import keys

TOKENS_A_SESSION = 250


class _Shift:
    """A session, how many tokens it has declared, and how many of them still stand."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.declared = 0
        self.standing = 0


class Presence:
    """The tokens of one process's vehicles; begins on `session`, which stays its owner's to close.

    `another` opens the sessions that follow, in a thread, and raises `zenoh.ZError` where it cannot; without it
    there are none. Everything is called on the event loop.
    """

    def __init__(self, session: zenoh.Session, another: Callable[[], zenoh.Session] | None) -> None:
        self._another = another
        self._shift = _Shift(session)
        self._tokens: dict[str, tuple[_Shift, zenoh.LivelinessToken]] = {}
        self._relief: asyncio.Task[None] | None = None
        self._opened: set[zenoh.Session] = set()
        self._closing: set[asyncio.Task[None]] = set()

    def announce(self, intersection: str, vehicle: str) -> None:
        """Declare that `vehicle` is there, until `withdraw` or `close`."""
        shift = self._shift
        self._tokens[vehicle] = shift, shift.session.liveliness().declare_token(keys.alive(intersection, vehicle))
        shift.declared += 1
        shift.standing += 1
        if shift.declared >= TOKENS_A_SESSION and self._another is not None and self._relief is None:
            self._relief = asyncio.create_task(self._relieve(self._another))

    def withdraw(self, vehicle: str) -> None:
        """Take the declaration back."""
        shift, token = self._tokens.pop(vehicle)
        token.undeclare()  # type: ignore[no-untyped-call]
        shift.standing -= 1
        self._dismiss(shift)

    async def close(self) -> None:
        """Close every session but the owner's, and with it take back what was declared there."""
        if self._relief is not None:
            await self._relief
        self._tokens.clear()
        for session in self._opened:
            self._close(session)
        await asyncio.gather(*self._closing, return_exceptions=True)

    async def _relieve(self, another: Callable[[], zenoh.Session]) -> None:
        over = self._shift
        try:
            session = await asyncio.to_thread(another)
        except zenoh.ZError:
            over.declared = 0  # it goes on; another try when as many again have come
            return
        finally:
            self._relief = None
        self._opened.add(session)
        self._shift = _Shift(session)
        self._dismiss(over)

    def _dismiss(self, shift: _Shift) -> None:
        """Close the session of a shift that is over, once nobody's token stands on it."""
        if shift is not self._shift and not shift.standing and shift.session in self._opened:
            self._opened.remove(shift.session)
            self._close(shift.session)

    def _close(self, session: zenoh.Session) -> None:
        task = asyncio.create_task(asyncio.to_thread(session.close))
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)
