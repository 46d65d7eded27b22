"""Looking at something over and over while it is measured."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import Self


class Beside(ABC):
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

    @abstractmethod
    def look(self) -> None:
        """Look once."""

    def _keep(self) -> None:
        while not self._done.wait(self.every_s):
            self.look()
