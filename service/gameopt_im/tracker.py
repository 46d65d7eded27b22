"""What the manager knows of every vehicle, from messages alone: pure and synchronous, no network, no clock.

Theory of operation. A vehicle is tracked from its first state (its zone entry) until one of these:

    left    heard to have passed the exit stretch, or predicted to have, once its rear stood clear of the
            conflict zone when last heard
    stale   uncleared, silent for `stale_s`, and could have stopped before the line when last heard: it does
            not hold up the others any longer
    lost    silent for `hold_s`: it held a clearance, or may have stood in the conflict zone, and was kept as
            silent until now; nobody knows where it is

Between states a vehicle is predicted (`tracking.predicted`), and marked silent once its state is too old.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gameopt_im.admission import ENDLESS, refused
from gameopt_im.core.bids import assign, class_bounds
from gameopt_im.core.conflicts import Ground
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.snapshot import NONE, Bools, Ints, Snapshot
from gameopt_im.core.tracking import LEFT, LOST, STALE, STAYS, Patience, fates, has_left
from gameopt_im.inbox import Raw, within
from gameopt_im.roster import Roster
from gameopt_im.tracked import Body, Heard, Tracked, heard_of, picture, shared
from gameopt_wire import codec, keys
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import STEP_S, Bid, Clock, State

Reason = Literal[
    "oversized", "malformed", "version", "out_of_range",  # the codec's
    "key", "unknown_movement", "uncovered", "time", "duplicate", "stale", "changed", "overload", "flood",
]  # fmt: skip
EventKind = Literal["entered", "left", "stale", "lost"]

FUTURE_S = 1.0
"""A state further ahead of the control cycle comes from a clock that is wrong."""
SILENT_CYCLES: dict[Clock, float] = {"lockstep": 1.01, "wall": 1.5}
"""Age in control cycles beyond which a vehicle counts as silent; under the wall clock delivery wavers."""
OUTSIDE_ZONE_M = 50.0
"""A distance this far outside the map's lanes is not believed."""
MESSAGES_EACH = 2
"""Messages that are read per control cycle for each vehicle there may be: a state and a bid."""
AFTER_EXIT_M = 60.0
"""Vehicles are kept this far past the stretch over which exit headways are opened (`exit.distance_m`)."""

_NOBODY: frozenset[str] = frozenset()
FATES: dict[int, EventKind] = {LEFT: "left", LOST: "lost", STALE: "stale"}
"""What is said of a vehicle that is dropped."""


@dataclass(frozen=True, slots=True)
class Event:
    """A vehicle came or went; `time_s` is the control cycle's, `heard_s` the time of its last state."""

    kind: EventKind
    vehicle: str
    time_s: float
    entered_s: float
    heard_s: float


class Tracker:
    """The vehicles of one intersection; `term` is the manager's, whose clearances are its own."""

    def __init__(
        self, intersection: IntersectionMap, ground: Ground, parameters: Parameters, clock: Clock, term: int
    ) -> None:
        self.received = 0
        self.bids = 0
        """Bids taken."""
        self.fallbacks = 0
        """Vehicles that say they are on their own, at the last snapshot."""
        self.rejected: Counter[Reason] = Counter()
        self._map = intersection
        self._ground = ground
        self._parameters = parameters
        self._clock = clock
        self._term = term
        self._movements = {movement.id: index for index, movement in enumerate(intersection.movements)}
        zones = [intersection.lanes[movement.lane].zone_m for movement in intersection.movements]
        self._ahead_m: list[float] = [zone_m + OUTSIDE_ZONE_M for zone_m in zones]
        self._exit_end_m = ground.length + ground.exit_length
        self._behind_m: list[float] = (self._exit_end_m + OUTSIDE_ZONE_M).tolist()
        service, stretch_m = parameters.service, parameters.exit.distance_m
        self._most = MESSAGES_EACH * service.max_vehicles
        self._patience = Patience(service.stale_s, service.hold_s, stretch_m, stretch_m + AFTER_EXIT_M)
        self._there = Roster()
        self.reserved: Collection[str] = _NOBODY
        """Who has a clearance, offered or accepted: they may not change their body. To be brought up to date once a
        control cycle has granted."""
        self._bids: dict[str, Bid] = {}
        self._gone: dict[str, float] = {}
        """When vehicles dropped a moment ago were last heard: a copy of a state that comes late is no new arrival."""
        self._events: list[Event] = []
        self._read = 0
        """Messages read since the last snapshot."""

    def reset(self) -> None:
        """Forgets every vehicle without a word, as when lock-step time begins anew; counters go on."""
        self._there.clear()
        self.reserved = _NOBODY
        self._bids.clear()
        self._gone.clear()
        self._events.clear()
        self._read = 0

    def has_room(self, messages: int) -> bool:
        """Whether so many more can be read for the next snapshot, whoever they are of; without a clock any number."""
        return self._clock != "wall" or self._read + messages <= self._most

    def ingest(self, messages: Sequence[Raw], now_s: float) -> None:
        """Takes in what arrived for the control cycle at `now_s`: counted whatever it is, never raised."""
        if self._clock == "wall":  # a step waits for all of its messages to be read
            messages, unread = within(messages, self._most, self._there.by_id, self._read)
            if unread:
                self.received += unread
                self.rejected["flood"] += unread
        self._read += len(messages)
        for raw in messages:
            if raw.kind == "gone":
                self.vanish(keys.vehicle_of(raw.key))
                continue
            try:
                message = (codec.STATE if raw.kind == "state" else codec.BID).decode(raw.payload)
            except codec.Rejected as rejected:
                self._count(rejected.reason)
                continue
            if not keys.is_of(raw.key, message.vehicle):
                self._count("key")
            elif isinstance(message, State):
                self.ingest_state(message, now_s)
            else:
                self.ingest_bid(message, now_s)

    def ingest_state(self, state: State, now_s: float) -> Reason | None:
        """Takes a state in; the reason where it is not taken."""
        known = self._there.by_id.get(state.vehicle)
        body = (state.movement, state.length_m, state.width_m, state.vehicle_class)
        if known is not None and known.body == body:
            reason = self._misplaced(state, known.movement, now_s) or _outdated(known.time_s, state)
            if reason is None:
                known.hear(state, self._term)
            return self._count(reason)
        movement = self._movements.get(state.movement)
        if movement is None:
            return self._count("unknown_movement")
        last_s = known.time_s if known else self._gone.get(state.vehicle)
        reason = self._misplaced(state, movement, now_s) or self._uncovered(state) or _outdated(last_s, state)
        if reason is None and known and self._holds_clearance(known):
            reason = "changed"
        if reason is None and known is None and len(self._there) >= ENDLESS * self._parameters.service.max_vehicles:
            reason = "overload"
        if reason is None:
            self._take(state, movement, known, now_s)
        return self._count(reason)

    def ingest_bid(self, bid: Bid, now_s: float) -> Reason | None:
        """Takes a bid in; it may come before its vehicle's first state. The reason where it is not taken."""
        known = self._bids.get(bid.vehicle)
        reason = self._wrong_time(bid.time_s, now_s) or _outdated(known.time_s if known else None, bid)
        stranger = known is None and bid.vehicle not in self._there.by_id
        if reason is None and stranger and len(self._bids) >= self._parameters.service.max_vehicles:
            reason = "overload"
        if reason is None:
            self._bids[bid.vehicle] = bid
            self.bids += 1
            vehicle = self._there.by_id.get(bid.vehicle)
            if vehicle is not None and (known is None or known.assertiveness != bid.assertiveness):
                vehicle.priority = assign(vehicle.bounds, bid.assertiveness)
                vehicle.note()
        return self._count(reason)

    def vanish(self, vehicle: str) -> None:
        """A vehicle's liveliness token is gone: under the wall clock it is silent until heard again.

        Tokens travel beside the messages that a lock-step counts, so there they would make runs differ.
        """
        known = self._there.by_id.get(vehicle)
        if known is not None and self._clock == "wall":
            known.vanished = True
            known.note()

    def vehicle(self, name: str) -> Tracked | None:
        """What was last heard of a vehicle, not predicted; None for one that is not tracked."""
        return self._there.by_id.get(name)

    def take_events(self) -> list[Event]:
        """Who came and went since the last call."""
        events, self._events = self._events, []
        return events

    def snapshot(self, cycle: int, time_s: float, reserved: Collection[str] = _NOBODY) -> Snapshot:
        """The picture of a control cycle; `reserved` are the vehicles with a clearance, offered or accepted.

        Vehicles that have left or been silent too long are dropped on the way, with an event each.
        """
        self.reserved, self._read = reserved, 0
        self._refuse()
        present, ids = self._there.ordered, self._there.ids
        heard = heard_of(present)
        held = np.array([*map(reserved.__contains__, ids)], dtype=np.bool_)
        become = self._fates(heard, held, time_s)
        if np.count_nonzero(become):
            self._drop(present, become, time_s)
            heard, held = heard.only(become == STAYS), held[become == STAYS]
            ids = self._there.ids
        self._forget(time_s)
        self.fallbacks = int(np.count_nonzero(heard.fallback))
        silent_s = SILENT_CYCLES[self._clock] * STEP_S
        return picture(cycle, time_s, ids, heard, held, self._ground, silent_s)

    def _refuse(self) -> None:
        """Lets newcomers go where there are too many; they never came."""
        excess = len(self._there) - self._parameters.service.max_vehicles
        if excess <= 0:
            return
        came = [self._there.by_id.get(event.vehicle) for event in self._events if event.kind == "entered"]
        names = refused([vehicle for vehicle in came if vehicle is not None], excess)
        if not names:
            return
        self._there.remove(names)
        self.rejected["overload"] += len(names)
        self._events = [event for event in self._events if event.kind != "entered" or event.vehicle not in names]

    def _holds_clearance(self, vehicle: Tracked) -> bool:
        return vehicle.name in self.reserved or vehicle.last.accepted != NONE

    def _drop(self, present: Sequence[Tracked], become: Ints, time_s: float) -> None:
        going = [(vehicle, fate) for vehicle, fate in zip(present, become.tolist(), strict=True) if fate != STAYS]
        self._there.remove([vehicle.name for vehicle, _ in going])
        for vehicle, fate in going:
            self._bids.pop(vehicle.name, None)
            self._gone[vehicle.name] = vehicle.time_s
            self._tell(FATES[fate], vehicle, time_s)

    def _count(self, reason: Reason | None) -> Reason | None:
        self.received += 1
        if reason is not None:
            self.rejected[reason] += 1
        return reason

    def _tell(self, kind: EventKind, vehicle: Tracked, time_s: float) -> None:
        self._events.append(Event(kind, vehicle.name, time_s, vehicle.entered_s, vehicle.time_s))

    def _wrong_time(self, time_s: float, now_s: float) -> Reason | None:
        return None if -self._parameters.service.stale_s <= time_s - now_s <= FUTURE_S else "time"

    def _misplaced(self, state: State, movement: int, now_s: float) -> Reason | None:
        if not -self._behind_m[movement] - state.length_m <= state.distance_m <= self._ahead_m[movement]:
            return "out_of_range"
        return self._wrong_time(state.time_s, now_s)

    def _uncovered(self, state: State) -> Reason | None:
        return None if self._map.covers(state.length_m, state.width_m) else "uncovered"

    def _take(self, state: State, movement: int, known: Tracked | None, now_s: float) -> None:
        """Begin a vehicle's record, or begin it anew for a body or movement that has changed."""
        bounds = class_bounds(self._parameters.classes, state.vehicle_class)
        bid = self._bids.get(state.vehicle)
        footprint = self._map.footprint_of(state.length_m, state.width_m)
        vehicle = Tracked(
            name=state.vehicle,
            body=shared(Body(state.movement, state.length_m, state.width_m, state.vehicle_class)),
            entered_s=known.entered_s if known else state.time_s,
            movement=movement,
            footprint=footprint,
            setback_m=float(self._ground.setback[movement, footprint]),
            bounds=bounds,
            priority=assign(bounds, bid.assertiveness if bid else bounds.assertiveness[0]),
        )
        vehicle.hear(state, self._term)
        vehicle.note()
        if known is None:
            rear_m = -state.distance_m - state.length_m - self._ground.clear[movement]
            if has_left(rear_m, -state.distance_m, self._exit_end_m[movement], self._patience):
                return  # it still speaks of the way behind the exit; that is nobody's entry
            self._tell("entered", vehicle, now_s)
        if known is not None:
            self._there.remove([state.vehicle])
        self._there.add(vehicle)

    def _forget(self, time_s: float) -> None:
        """Bids of vehicles that never came or have gone, and the gone, once their messages are too old to be taken."""
        oldest_s = time_s - self._parameters.service.stale_s
        for name in self._bids.keys() - self._there.by_id.keys():
            if self._bids[name].time_s < oldest_s:
                del self._bids[name]
        for name in [name for name, last_s in self._gone.items() if last_s < oldest_s]:
            del self._gone[name]

    def _fates(self, heard: Heard, held: Bools, time_s: float) -> Ints:
        return fates(
            heard.time, heard.s, heard.v, heard.length, heard.b_max, heard.movement, heard.accepted, heard.vanished,
            held, self._ground.clear, self._exit_end_m, time_s, self._patience,
        )  # fmt: skip


def _outdated(last_s: float | None, new: State | Bid) -> Reason | None:
    """The latest message of a vehicle wins; `last_s` is the time of the one before."""
    if last_s is None or new.time_s > last_s:
        return None
    return "duplicate" if new.time_s == last_s else "stale"
