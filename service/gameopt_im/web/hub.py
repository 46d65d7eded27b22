"""Who watches the live page, and the newest frame for each: no network here.

Theory of operation. A frame is made once for all viewers, when a control cycle's commands are out, and only while
somebody watches. Each viewer has room for one: whoever has not taken the last one yet gets the newest instead of it,
so nobody is waited for, and nothing piles up.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import structlog

from gameopt_im.manager import Outcome
from gameopt_im.options import ServeOptions
from gameopt_im.sight import Sight
from gameopt_im.web.frames import frame_of, hello_of

log = structlog.get_logger()

MOST_VIEWERS = 32
LEAST_GAP_S = 0.05
"""Lock-step can run many control cycles a second; nobody sees more frames than this apart."""


class CrowdedError(Exception):
    """So many watch already that one more is refused."""


class Viewer:
    """One who watches. `selected` is the vehicle it wants details of, `skipped` the frames it was too slow for."""

    def __init__(self) -> None:
        self.selected: str | None = None
        self.skipped = 0
        self._newest: bytes | None = None
        self._there = asyncio.Event()
        self._over = False

    def put(self, frame: bytes) -> None:
        """Leave a frame, in place of one that has not been taken."""
        self.skipped += self._newest is not None
        self._newest = frame
        self._there.set()

    def end(self) -> None:
        """There will be no more frames."""
        self._over = True
        self._there.set()

    async def take(self) -> bytes | None:
        """The newest frame, as soon as there is one that was not taken; None when there will be no more."""
        await self._there.wait()
        if self._over:
            return None
        self._there.clear()
        frame, self._newest = self._newest, None
        return frame


class Hub:
    """The viewers of one manager; `now` is a monotonic clock, s."""

    def __init__(self, options: ServeOptions, term: int, now: Callable[[], float] = time.monotonic) -> None:
        self._options = options
        self._term = term
        self._now = now
        self._viewers: set[Viewer] = set()
        self._encode = msgspec.json.Encoder().encode
        self._hello: bytes | None = None
        self._shown_s = -LEAST_GAP_S
        self._crossed, self._in_zone_s = 0, 0.0

    @contextmanager
    def viewing(self) -> Iterator[Viewer]:
        """A viewer for as long as the context is open. Raises `CrowdedError`."""
        if len(self._viewers) >= MOST_VIEWERS:
            raise CrowdedError
        viewer = Viewer()
        self._viewers.add(viewer)
        try:
            yield viewer
        finally:
            self._viewers.discard(viewer)

    def hello(self) -> bytes:
        """What a viewer is told first."""
        if self._hello is None:
            self._hello = self._encode(hello_of(self._options, self._term))
        return self._hello

    def cycle_done(self, outcome: Outcome, sight: Sight | None) -> None:
        """A control cycle has ended and its messages are out: show it to whoever watches."""
        if not self._viewers or sight is None:
            return
        for entry in outcome.ledger:
            if entry.left_s is not None:
                self._crossed += 1
                self._in_zone_s += entry.left_s - entry.entered_s
        now_s = self._now()
        if now_s - self._shown_s < LEAST_GAP_S:
            return
        self._shown_s = now_s
        try:
            self._show(outcome, sight)
        except Exception:  # being watched must not end the managing of an intersection
            log.exception("no frame for the live page")
            self.close()

    def close(self) -> None:
        """Send everybody away; they may come back."""
        for viewer in self._viewers:
            viewer.end()

    def _show(self, outcome: Outcome, sight: Sight) -> None:
        selected = {viewer.selected for viewer in self._viewers if viewer.selected is not None}
        frame = self._encode(
            frame_of(sight, outcome.report, self._options.parameters, self._crossed, self._in_zone_s, selected)
        )
        for viewer in self._viewers:
            viewer.put(frame)
