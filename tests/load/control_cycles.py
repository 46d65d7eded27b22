"""The manager's control cycles as it reports them, heard beside the vehicles, and those that nothing slowed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import zenoh
from machine import FixedWork

from gameopt_vehicles import bus
from gameopt_vehicles.timings import Spread, Timings
from gameopt_wire import codec, keys


@dataclass(frozen=True)
class AtSpeed:
    """Control cycles in which no core was ever slow: their share, and the whole way of those.

    `slow_percent` is how much of the time a core was slow (`machine.FixedWork`), on average.
    """

    slow_percent: float
    share_percent: float
    whole: Spread | None


@dataclass
class ControlCycles:
    """Listens to a manager at `endpoint` from a session of its own; `ways` is when each report came, and its whole way.

    Both in s, by the monotonic clock. Reports go out after the commands: the whole way ends where its report comes.
    """

    endpoint: str
    ways: list[tuple[float, float]] = field(default_factory=list)

    def __enter__(self) -> ControlCycles:
        self._session = zenoh.open(bus.configuration((self.endpoint,), None))
        self._subscriber = self._session.declare_subscriber(f"{keys.ROOT}/*/cycle", self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def _hear(self, sample: zenoh.Sample) -> None:
        came_s, report = time.perf_counter(), codec.CYCLE.decode(bytes(sample.payload))
        if report.whole_ms is not None:
            self.ways.append((came_s, 1e-3 * report.whole_ms))

    def at_speed(self, noise: Sequence[FixedWork], from_s: float, until_s: float) -> AtSpeed:
        """Of those that were reported in this time."""
        ways = [way for way in self.ways if from_s <= way[0] <= until_s]
        spans = [(came_s - whole_s, came_s) for came_s, whole_s in ways]
        whole = Timings()
        for (_, whole_s), *at_speed in zip(ways, *(core.at_speed(spans) for core in noise), strict=True):
            if all(at_speed):
                whole.observe(whole_s)
        slow = [slow for core in noise for slow in core.slow()]
        share = round(100.0 * whole.count / len(ways), 1) if ways else 0.0
        return AtSpeed(round(100.0 * sum(slow) / max(1, len(slow)), 1), share, whole.spread())
