"""Looking at something over and over while it is measured."""

from __future__ import annotations

import threading
from typing import Self


class Beside:
    """As a context: `look` every `every_s` seconds, on a thread of its own, until the context is left."""

    every_s: float

    def __enter__(self) -> Self:
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._keep)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def begin(self) -> None:
        """What there is to do on the thread before it looks for the first time."""

    def look(self) -> None:
        """Look once."""
        raise NotImplementedError

    def _keep(self) -> None:
        self.begin()
        while not self._done.wait(self.every_s):
            self.look()
