"""Who holds which time windows on the conflict areas: the reservations behind every clearance given."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import kernel
from gameopt_im.core.snapshot import Bools, Floats, Ints
from gameopt_im.core.windows import HORIZON, crossing_time, occupancy, overlap, step_at

LOOSE = -1
"""In place of a row: no reservation, and nothing is known of where that vehicle goes."""


@dataclass(frozen=True, slots=True)
class Reservation:
    """A clearance and the ground it holds: nominal and worst-case way through the zone.

    `x`, `v` (HORIZON,) are the profile offered, `late_x`, `late_v` the worst case of it, with everyone ahead braking as
    much as rule 2 and the exit law may make them; index 0 is control cycle `start`, at `start_s`. Windows begin with x
    and end with late_x.
    `done` is the step at which the rear is clear in the worst case. `withdrawn` asks the vehicle to give it back.
    `told` is the control cycle of the last state that the worst case was brought up to date by.
    """

    vehicle: str
    clearance: int
    start: int
    movement: int
    footprint: int
    lane: int
    length: float
    b: float
    x: Floats
    v: Floats
    late_x: Floats
    late_v: Floats
    done: int
    start_s: float
    expires_s: float
    price: float = 0.0
    bid: float = 0.0
    accepted: bool = False
    withdrawn: bool = False
    told: int = -1

    def step(self, cycle: int) -> int:
        """The index of a control cycle in the arrays."""
        return int(step_at(self.start, cycle))

    def crosses(self, cycle: int) -> float:
        """When its front crosses the line, s from a control cycle; negative once it has."""
        return float(crossing_time(self.x, self.start, cycle))

    def speeds(self) -> list[float]:
        """The offered speeds, up to the step at which the rear is clear in the nominal case."""
        return [float(u) for u in self.v[: self.done + 1]]


class Rows(NamedTuple):
    """Reservations as arrays for the kernels, one a row; what lies beyond a book's last row means nothing."""

    x: Floats
    v: Floats
    late_x: Floats
    late_v: Floats
    start: Ints
    movement: Ints
    footprint: Ints
    length: Floats
    b: Floats
    clearance: Ints
    expires_s: Floats
    accepted: Bools
    withdrawn: Bools
    told: Ints


def _rows(count: int) -> Rows:
    x, v, late_x, late_v = np.zeros((4, count, HORIZON))
    start, movement, footprint, clearance, told = np.zeros((5, count), np.int64)
    length, b, expires_s = np.zeros((3, count))
    accepted, withdrawn = np.zeros((2, count), np.bool_)
    return Rows(
        x, v, late_x, late_v, start, movement, footprint, length, b, clearance, expires_s, accepted, withdrawn, told
    )


def held_in(row: Ints, column: Bools) -> Bools:
    """(n,): what a column of `Rows` says of each vehicle's reservation; false where it has none."""
    return np.asarray((row >= 0) & column[row])


class Stack(NamedTuple):
    """The rows in use, R of them, as seen from a control cycle: `first` is each one's index of now."""

    x: Floats
    late_x: Floats
    first: Ints
    movement: Ints
    footprint: Ints
    length: Floats


@dataclass(slots=True)
class Book:
    """All reservations in force; each vehicle holds one at the most, and each has its row.

    The `late_x` and `late_v` of what is held are views of its row: worst cases are brought up to date in place.
    """

    held: dict[str, Reservation] = field(default_factory=dict)
    row: dict[str, int] = field(default_factory=dict)
    rows: Rows = field(default_factory=lambda: _rows(64))
    _asked: tuple[tuple[str, ...], Ints] | None = None
    """Whose rows were asked for last, and they; None since rows changed hands."""
    _stack: tuple[int, Stack] | None = None
    """The control cycle from which the rows were seen last, and how; None since rows changed hands."""

    def add(self, reservation: Reservation) -> None:
        """Enter a reservation; its windows have been checked against every other in the book."""
        self.make_room(1)
        self._asked = self._stack = None
        row = self.row.setdefault(reservation.vehicle, len(self.row))
        for name in Rows._fields:
            getattr(self.rows, name)[row] = getattr(reservation, name)
        self.held[reservation.vehicle] = self._viewing(reservation, row)

    def make_room(self, count: int) -> None:
        """See to it that `count` reservations more can be added while the rows stay where they are."""
        while len(self.row) + count > len(self.rows.start):
            grown = _rows(2 * len(self.rows.start))
            for old, new in zip(self.rows, grown, strict=True):
                new[: len(old)] = old
            self.rows, self._stack = grown, None
            self.held = {vehicle: self._viewing(each, self.row[vehicle]) for vehicle, each in self.held.items()}

    def _viewing(self, reservation: Reservation, row: int) -> Reservation:
        return replace(reservation, late_x=self.rows.late_x[row], late_v=self.rows.late_v[row])

    def accept(self, vehicle: str) -> None:
        """The vehicle has taken its clearance: from now on it holds the ground until it has left it."""
        self.held[vehicle] = replace(self.held[vehicle], accepted=True)
        self.rows.accepted[self.row[vehicle]] = True

    def withdraw(self, vehicle: str, withdrawn: bool = True) -> None:
        """Ask for the clearance back, or no longer; the ground is held until the vehicle has said that it drops it."""
        self.held[vehicle] = replace(self.held[vehicle], withdrawn=withdrawn)
        self.rows.withdrawn[self.row[vehicle]] = withdrawn

    def rows_of(self, vehicles: tuple[str, ...]) -> Ints:
        """(n,): the row of each vehicle's reservation, LOOSE where it has none; not to be written to."""
        if self._asked is None or self._asked[0] is not vehicles:
            row_of = self.row.get
            row = np.array([row_of(vehicle, LOOSE) for vehicle in vehicles], dtype=np.int64)
            self._asked = vehicles, row
        return self._asked[1]

    def price(self, vehicle: str, price: float, bid: float) -> None:
        """What the clearance costs when it is taken, and the bid it was won with."""
        self.held[vehicle] = replace(self.held[vehicle], price=price, bid=bid)

    def free(self, vehicle: str) -> Reservation:
        """Give the ground back. The last row moves into the one that is free now."""
        self._asked = self._stack = None
        last, hole = len(self.row) - 1, self.row.pop(vehicle)
        if hole != last:
            moved = next(each for each, row in self.row.items() if row == last)
            for part in self.rows:
                part[hole] = part[last]
            self.row[moved] = hole
            self.held[moved] = self._viewing(self.held[moved], hole)
        return self.held.pop(vehicle)

    def by_row(self) -> list[str]:
        """Whose reservation each row is."""
        return sorted(self.row, key=self.row.__getitem__)

    def stack(self, cycle: int) -> Stack:
        """The arrays of all reservations, as seen from a control cycle."""
        if self._stack is None or self._stack[0] != cycle:
            rows, used = self.rows, len(self.row)
            first = np.minimum(np.maximum(cycle - rows.start[:used], 0), HORIZON - 1)
            arrays = (rows.x, rows.late_x, first, rows.movement, rows.footprint, rows.length)
            self._stack = cycle, Stack._make(array[:used] for array in arrays)
        return self._stack[1]


@kernel
def clash(
    x: Floats,
    late_x: Floats,
    length: float,
    movement: int,
    footprint: int,
    held_x: Floats,
    held_late_x: Floats,
    first: Ints,
    held_movement: Ints,
    held_footprint: Ints,
    held_length: Floats,
    windows: Floats,
    margin_s: float,
    margin_m: float,
) -> float:
    """How much later a profile (from now) would have to come to be disjoint from every reservation, s; 0 if it is."""
    worst = 0.0
    for r in range(first.shape[0]):
        mine = windows[movement, footprint, held_movement[r], held_footprint[r]]
        if not mine[1] > -1e8:  # NaN: the two never touch
            continue
        its = windows[held_movement[r], held_footprint[r], movement, footprint]
        other = occupancy(held_x[r], held_late_x[r], first[r], held_length[r], its[0], its[1])
        me = occupancy(x, late_x, 0, length, mine[0], mine[1])
        worst = max(worst, overlap(me, other, margin_s, margin_m))
    return worst


@kernel
def blocked_windows(
    movement: Ints,
    footprint: Ints,
    length: Floats,
    held_x: Floats,
    held_late_x: Floats,
    first: Ints,
    held_movement: Ints,
    held_footprint: Ints,
    held_length: Floats,
    windows: Floats,
) -> Floats:
    """(n, R, 4) for the slot planner: each reservation's window (in, out) and my entry and leaving distance."""
    n, m = movement.shape[0], first.shape[0]
    out = np.full((n, m, 4), np.nan)
    for i in range(n):
        for r in range(m):
            mine = windows[movement[i], footprint[i], held_movement[r], held_footprint[r]]
            if not mine[1] > -1e8:
                continue
            its = windows[held_movement[r], held_footprint[r], movement[i], footprint[i]]
            other = occupancy(held_x[r], held_late_x[r], first[r], held_length[r], its[0], its[1])
            if other[1] < 0.0:
                continue
            out[i, r, 0], out[i, r, 1] = other[0], other[1]
            out[i, r, 2], out[i, r, 3] = mine[0], mine[1] + length[i]
    return out
