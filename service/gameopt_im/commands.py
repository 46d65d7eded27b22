"""A control cycle's conclusion as messages: one command a vehicle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gameopt_im.core.decision import Conclusion
from gameopt_im.core.interlock import INTRUDING, Limits
from gameopt_im.core.reservations import Reservation
from gameopt_im.core.snapshot import Snapshot
from gameopt_wire.messages import Clearance, Command

LATEST_S = 1e6
"""A slot farther off than this is none."""


def commands_of(
    snapshot: Snapshot,
    limits: Limits,
    concluded: Conclusion,
    held: Mapping[str, Reservation],
    term: int,
    valid_s: float,
) -> list[Command]:
    """One command for every vehicle that was heard, valid for `valid_s`; a silent one falls back by itself."""
    rank = np.full(len(snapshot), -1)
    rank[concluded.order] = np.arange(len(concluded.order))
    now_s = snapshot.time_s
    valid_until_s = now_s + valid_s
    slots = np.where(concluded.slots < LATEST_S, np.maximum(0.0, now_s + concluded.slots), np.nan)  # NaN for none
    offers = limits.phase != INTRUDING
    columns = (concluded.speeds, slots, np.isnan(slots), rank, offers, snapshot.silent)
    commands = []
    for vehicle, speed, slot, slotless, turn, offered, silent in zip(
        snapshot.ids, *(column.tolist() for column in columns), strict=True
    ):
        if silent:
            continue
        reservation = held.get(vehicle)
        commands.append(
            Command(
                vehicle=vehicle,
                term=term,
                cycle=snapshot.cycle,
                time_s=now_s,
                speed_mps=speed,
                valid_until_s=valid_until_s,
                slot_s=None if slotless else slot,
                clearance=_offer(reservation, now_s) if offered else None,
                cleared=_known(reservation),
                withdrawn=reservation.clearance if reservation is not None and reservation.withdrawn else None,
                rank=turn,
                price=reservation.price if reservation is not None else 0.0,
            )
        )
    return commands


def _offer(reservation: Reservation | None, now_s: float) -> Clearance | None:
    """The clearance to offer, again and again until it is taken or has expired."""
    if reservation is None or reservation.accepted or reservation.withdrawn:
        return None
    if reservation.clearance == 0 or now_s > reservation.expires_s:
        return None
    return Clearance(
        id=reservation.clearance,
        start_s=reservation.start_s,
        expires_s=reservation.expires_s,
        speeds_mps=reservation.speeds(),
    )


def _known(reservation: Reservation | None) -> int | None:
    """The clearance taken: the command's speed is made for it. Not one asked back: who keeps it drives it unaided."""
    if reservation is None or not reservation.accepted or reservation.withdrawn:
        return None
    return reservation.clearance
