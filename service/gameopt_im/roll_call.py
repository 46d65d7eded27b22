"""Who has still to be heard before a control cycle need not wait any longer."""

from __future__ import annotations

from collections.abc import Callable, Collection


class RollCall:
    """Keys crossed out by the threads that messages come on; `on_complete` is called there, with the last one."""

    def __init__(self, on_complete: Callable[[], object]) -> None:
        self._on_complete = on_complete
        self._awaited: set[str] = set()

    def begin(self, keys: Collection[str]) -> None:
        """Wait for these, from now on; whoever was waited for before is not any more."""
        self._awaited = set(keys)

    def heard(self, key: str) -> None:
        """Cross one out, whether it was waited for or not."""
        awaited = self._awaited  # another may begin meanwhile: then this one comes to nothing
        if key in awaited:
            awaited.discard(key)
            if not awaited:
                self._on_complete()
