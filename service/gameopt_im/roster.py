"""Who is there, by id and in order."""

from __future__ import annotations

from bisect import insort
from collections.abc import Collection

from gameopt_im.tracked import Tracked


class Roster:
    """The vehicles of one intersection: `by_id`, and `ordered` by zone entry, then id. To be read, not written."""

    def __init__(self) -> None:
        self.by_id: dict[str, Tracked] = {}
        self.ordered: list[Tracked] = []
        self._ids: tuple[str, ...] | None = ()

    def __len__(self) -> int:
        return len(self.by_id)

    @property
    def ids(self) -> tuple[str, ...]:
        """Their ids in order: one tuple for as long as nobody comes or goes, to be known again by what it is."""
        if self._ids is None:
            self._ids = tuple([vehicle.name for vehicle in self.ordered])
        return self._ids

    def add(self, vehicle: Tracked) -> None:
        """One more, who is not there yet."""
        self._ids = None
        self.by_id[vehicle.name] = vehicle
        insort(self.ordered, vehicle, key=lambda each: (each.entered_s, each.name))

    def remove(self, ids: Collection[str]) -> None:
        """All of these at once, who are there: a thousand go in the time of one."""
        if ids:
            self._ids = None
            for vehicle in ids:
                del self.by_id[vehicle]
            self.ordered = [each for each in self.ordered if each.name in self.by_id]

    def clear(self) -> None:
        """Nobody is there."""
        self.by_id.clear()
        self.ordered.clear()
        self._ids = ()
