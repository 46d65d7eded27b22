"""What a vehicle waits for: the command that answers its state."""

from __future__ import annotations

import msgspec

from gameopt_vehicles.timings import Spread, Timings


class RoundTrip(msgspec.Struct, kw_only=True):
    """From the put of a state to the command that answers it; `unanswered` states had none before the next was put."""

    count: int
    unanswered: int
    p50_ms: float | None = None
    p99_ms: float | None = None
    p999_ms: float | None = None
    max_ms: float | None = None


class RoundTrips:
    """Round trips of all vehicles, on the monotonic clock.

    A command answers a state if it is of the state's control cycle, or of a later one. One made without the state,
    which came too late for it, cannot be told from one made with it: either way the vehicle has what it drives by.
    """

    def __init__(self) -> None:
        self.unanswered = 0
        self._timings = Timings()
        self._waiting: dict[str, tuple[int, float]] = {}

    def restart(self) -> None:
        """Begin to count anew; who waits goes on waiting."""
        self.unanswered, self._timings = 0, Timings()

    def asked(self, vehicle: str, cycle: int, put_s: float) -> None:
        """The state of a control cycle is handed to Zenoh."""
        if vehicle in self._waiting:
            self.unanswered += 1
        self._waiting[vehicle] = (cycle, put_s)

    def answered(self, vehicle: str, cycle: int, received_s: float) -> None:
        """A command of a control cycle has come."""
        waiting = self._waiting.get(vehicle)
        if waiting is not None and cycle >= waiting[0]:
            del self._waiting[vehicle]
            self._timings.observe(received_s - waiting[1])

    def gone(self, vehicle: str) -> None:
        """It has left the road, and no longer waits."""
        self._waiting.pop(vehicle, None)

    def summary(self) -> RoundTrip:
        """What came of it so far."""
        spread: Spread | None = self._timings.spread()
        figures = {} if spread is None else msgspec.structs.asdict(spread)
        return RoundTrip(count=self._timings.count, unanswered=self.unanswered, **figures)
