"""What the live page is sent: once how the manager runs and on which map, then a frame a control cycle.

`frame_of` is a pure function of what a control cycle made. Lengths in m, speeds in m/s, durations in s; `time_s` is
the manager's. Numbers are rounded to what can be seen: a frame is sent ten times a second.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from importlib.metadata import version
from typing import Any, Literal

import msgspec
import numpy as np

from gameopt_im.core.interlock import CLEARED, EXITING, INTRUDING
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.planning import Candidate, stake_of
from gameopt_im.core.reservations import Reservation
from gameopt_im.core.snapshot import Floats
from gameopt_im.options import ServeOptions
from gameopt_im.sight import Sight
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Clock, CycleReport, Geometry, Profile

Status = Literal["waiting", "offered", "cleared", "withdrawn", "leaving", "intruding"]
"""No clearance yet; one is offered; taken; asked back; past the conflict zone; in it without a clearance."""

FARTHEST_S = 600.0
"""A slot farther off than this is none."""
ORDER_SHOWN = 24
"""Turns of a candidate sequence that are sent."""


class Hello(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="hello"):
    """How the manager runs; a new `term` is a new manager. `weights` are omega for T, D, W, A, one a candidate."""

    version: str
    term: int
    clock: Clock
    profile: Profile
    geometry: Geometry
    weights: list[tuple[float, float, float, float]]
    incumbent_bonus: float
    map: IntersectionMap


class Car(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A vehicle, sent as an array in the order of these fields.

    `movement` and `footprint` are indices into the map's; `distance_m` runs to the stop line, negative past it; `rank`
    counts from 0 in the crossing order, -1 for none; `slot_s` is from now, None for none; `price` is that of the
    clearance offered or taken.
    """

    vehicle: str
    vehicle_class: str
    movement: int
    footprint: int
    distance_m: float
    speed_mps: float
    length_m: float
    width_m: float
    status: Status
    rank: int
    slot_s: float | None
    waited_s: float
    silent: bool
    fallback: bool
    price: float


class Contender(msgspec.Struct, frozen=True, gc=False):
    """A candidate sequence. `number` is its weight vector's, -1 for the incumbent.

    `cost` is what the choice went by; where the program was not `solved`, what it would have cost at the least.
    `order` are the first turns, as indices into the frame's vehicles.
    """

    number: int
    cost: float
    delay_s: float | None
    objective: float | None
    solved: bool
    won: bool
    order: list[int]


class Detail(msgspec.Struct, frozen=True, gc=False):
    """More of a vehicle that somebody has selected.

    `bids` are its master bids with transfers, one a weight vector, empty once it does not bid any more. `bid` is what
    its clearance was won with. `profile_mps` are the speeds of its clearance from now on, 0.1 s apart.
    """

    assertiveness: float
    speed_priority: float
    variation_priority: float
    bids: list[float]
    bid: float | None
    accepted: bool
    profile_mps: list[float]


class Frame(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="frame"):
    """One control cycle. Totals run from some moment on, so only their differences mean something.

    `crossed_total` are vehicles that have left the conflict zone, `in_zone_total_s` the times since their zone entry.
    """

    cycle: int
    time_s: float
    elapsed_ms: float
    stages_ms: dict[str, float]
    missed_total: int
    crossed_total: int
    in_zone_total_s: float
    cars: list[Car]
    contenders: list[Contender]
    details: dict[str, Detail]


def hello_of(options: ServeOptions, term: int) -> Hello:
    """What a viewer is told first."""
    parameters = options.parameters
    return Hello(
        version=version("gameopt"),
        term=term,
        clock=options.clock,
        profile=options.profile,
        geometry=options.geometry,
        weights=parameters.auction.weights[: options.candidates],
        incumbent_bonus=parameters.planner.incumbent_bonus,
        map=options.map,
    )


def frame_of(
    sight: Sight,
    report: CycleReport,
    parameters: Parameters,
    crossed_total: int = 0,
    in_zone_total_s: float = 0.0,
    selected: Collection[str] = (),
) -> Frame:
    """The frame of a control cycle, with details of the `selected` vehicles that are present."""
    place = {vehicle: i for i, vehicle in enumerate(sight.snapshot.ids)}
    return Frame(
        cycle=report.cycle,
        time_s=report.time_s,
        elapsed_ms=round(report.elapsed_ms, 2),
        stages_ms={stage: round(elapsed_ms, 2) for stage, elapsed_ms in report.stages_ms.items()},
        missed_total=report.missed_total,
        crossed_total=crossed_total,
        in_zone_total_s=round(in_zone_total_s, 1),
        cars=_cars(sight),
        contenders=list(_contenders(sight, parameters)),
        details={vehicle: _detail(sight, place[vehicle]) for vehicle in selected if vehicle in place},
    )


def _cars(sight: Sight) -> list[Car]:
    snapshot, concluded, held = sight.snapshot, sight.concluded, sight.book.held
    rank = np.full(len(snapshot), -1)
    rank[concluded.order] = np.arange(len(concluded.order))
    seen = (concluded.slots >= 0.0) & (concluded.slots < FARTHEST_S)
    columns = (
        snapshot.movement, snapshot.footprint, _seen(snapshot.s), _seen(snapshot.v), snapshot.length, sight.phase, rank,
        seen, _seen(np.where(seen, concluded.slots, 0.0)), np.round(snapshot.waited, 1), snapshot.silent,
    )  # fmt: skip
    cars = []
    for vehicle, movement, footprint, s, v, length, phase, turn, has_slot, slot, waited, silent in zip(
        snapshot.ids, *(column.tolist() for column in columns), strict=True
    ):
        known, reservation = sight.tracked(vehicle), held.get(vehicle)
        if known is None:
            continue  # never: who is in the snapshot is tracked until the next one
        price = round(reservation.price, 4) if reservation is not None else 0.0
        shown_s = slot if has_slot else None
        status = _status(phase, reservation)
        body = known.body.vehicle_class, movement, footprint, s, v, length, known.body.width_m
        cars.append(Car(vehicle, *body, status, turn, shown_s, waited, silent, bool(known.last.fallback), price))
    return cars


def _status(phase: int, reservation: Reservation | None) -> Status:
    if phase == INTRUDING:
        return "intruding"
    if phase == EXITING:
        return "leaving"
    if reservation is not None and reservation.withdrawn:
        return "withdrawn"
    if phase == CLEARED:
        return "cleared"
    return "offered" if reservation is not None and reservation.clearance else "waiting"


def _contenders(sight: Sight, parameters: Parameters) -> Iterator[Contender]:
    """The candidates in the order in which they were proposed; those of every profile."""
    proposal, results, winner = sight.proposal, sight.results, sight.winner
    for k, option in enumerate(proposal.candidates):
        result = results[k] if k < len(results) else None
        objective = None if result is None else round(result.objective, 4)
        number, delay_s, rows = _read(k, option)
        cost = objective or 0.0
        if isinstance(option, Candidate):
            cost = stake_of(option, parameters, solved=bool(proposal.jobs)).cost(cost)
        yield Contender(
            number=number,
            cost=round(cost, 4),
            delay_s=delay_s,
            objective=objective,
            solved=objective is not None or not proposal.jobs,
            won=winner is not None and winner.number == number,
            order=sight.who.index[rows[:ORDER_SHOWN]].tolist(),
        )


def _read(k: int, option: Any) -> tuple[int, float | None, Any]:
    """(number, predicted weighted delay, the bidders' rows in order) of a profile's k-th candidate."""
    if isinstance(option, Candidate):
        return option.weights, round(option.delay, 3), option.order
    return k, None, getattr(option, "order", option)  # the stop sign's only one; the paper's are bare orders


def _detail(sight: Sight, i: int) -> Detail:
    snapshot = sight.snapshot
    reservation = sight.book.held.get(snapshot.ids[i])
    row = np.flatnonzero(sight.who.index == i)
    bids = sight.who.bids[:, row[0]] if len(row) else np.empty(0)
    cleared = reservation is not None and reservation.clearance > 0
    profile = np.empty(0)
    if reservation is not None and cleared:
        profile = reservation.v[reservation.step(snapshot.cycle) : reservation.done + 1]
    return Detail(
        assertiveness=round(float(snapshot.assertiveness[i]), 3),
        speed_priority=round(float(snapshot.speed_priority[i]), 3),
        variation_priority=round(float(snapshot.variation_priority[i]), 3),
        bids=np.round(bids, 4).tolist(),
        bid=round(reservation.bid, 4) if reservation is not None and cleared else None,
        accepted=reservation is not None and reservation.accepted,
        profile_mps=_seen(profile).tolist(),
    )


def _seen(values: Floats) -> Floats:
    """To the centimetre."""
    return np.round(values, 2)
