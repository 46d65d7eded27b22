"""What vehicles pay: the entries to publish, and which of them are still open."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import structs

from gameopt_im.core.decision import Settled
from gameopt_im.tracker import Event
from gameopt_wire.messages import LedgerEntry


class Ledger:
    """The entries of one term. An entry is open from the clearance taken until its vehicle has left the zone."""

    def __init__(self, term: int) -> None:
        self._term = term
        self._entered: dict[str, float] = {}
        self._open: dict[str, LedgerEntry] = {}

    def clear(self) -> None:
        """Time has begun anew: nobody has ever come."""
        self._entered.clear()
        self._open.clear()

    def write(self, settled: Settled, events: Iterable[Event], time_s: float) -> list[LedgerEntry]:
        """An entry when a clearance is taken and paid for, and again when its vehicle has left the zone."""
        for event in events:
            if event.kind == "entered":
                self._entered[event.vehicle] = event.entered_s
                continue
            self._entered.pop(event.vehicle, None)
            self._open.pop(event.vehicle, None)
        entries = []
        for taken in settled.accepted:
            entry = LedgerEntry(
                vehicle=taken.vehicle,
                term=self._term,
                entered_s=self._entered.get(taken.vehicle, time_s),
                cleared_s=time_s,
                price=taken.price,
                bid=taken.bid,
            )
            self._open[taken.vehicle] = entry
            entries.append(entry)
        for gone in settled.left:
            paid = self._open.pop(gone.vehicle, None)
            if paid is not None:
                entries.append(structs.replace(paid, left_s=time_s))
        for back in settled.returned:
            paid = self._open.pop(back.vehicle, None)
            if paid is not None:
                entries.append(structs.replace(paid, price=0.0))  # it has not got what it paid for
        return entries
