"""A clearance given into a gap before somebody who has one already: only if that one need not slow down for it."""

from __future__ import annotations

import numpy as np
import pytest
from builders import ACROSS, OTHER, four_arm, movement

from gameopt_im.core.conflicts import ground
from gameopt_im.core.followers import holds_up
from gameopt_im.core.reservations import Book, Reservation
from gameopt_im.core.windows import HORIZON
from gameopt_wire.messages import STEP_S

SHARED = [movement(i, **({"exit_lane": "shared"} if i in {ACROSS, OTHER} else {})) for i in range(12)]
MERGING = ground(four_arm(movements=SHARED), "areas", 25.0, turn_speed=True)
APART = ground(four_arm(), "areas", 25.0, turn_speed=True)


def crossing(movement: int, x: float, v: float, late_v: float | None = None) -> Reservation:
    """A car's clearance at constant speed, from x past the line; slower in the worst case."""
    times = np.arange(HORIZON) * STEP_S
    slow = v if late_v is None else late_v
    return Reservation(
        vehicle=f"on {movement}", clearance=1, start=0, movement=movement, footprint=0, lane=movement, length=5.0,
        b=4.5, x=x + v * times, v=np.full(HORIZON, v), late_x=x + slow * times, late_v=np.full(HORIZON, slow), done=90,
        start_s=0.0, expires_s=0.5, accepted=True,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("made", "held_up"),
    [
        (crossing(ACROSS, 10.0, 2.0), True),  # on the exit 0.2 s before it, and slow
        (crossing(ACROSS, -20.0, 12.0), False),  # well before it, and fast
        (crossing(ACROSS, -20.0, 12.0, 8.0), True),  # but not in its worst case
        (crossing(ACROSS, -60.0, 10.0), False),  # behind it
    ],
)
def test_a_new_clearance_may_not_slow_down_who_comes_after_on_the_exit(made: Reservation, held_up: bool) -> None:
    book = Book()
    book.add(crossing(OTHER, -30.0, 10.0))  # on the exit after 5.7 s
    assert holds_up(book, MERGING, made, 0) is held_up
    assert not holds_up(book, APART, made, 0)
