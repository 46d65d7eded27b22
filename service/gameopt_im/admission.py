"""Who is not taken in where there are more vehicles than the manager answers for: pure functions of their states.

Whoever is refused gets no commands, so it stops before its line by itself, and the vehicle behind it, whose radar sees
somebody the manager does not know, gets no clearance. A newcomer that may have to cross is not refused: one that says
it follows a clearance, has passed its line, or cannot stop before it.
"""

from __future__ import annotations

from collections.abc import Iterable

from gameopt_im.tracked import Tracked
from gameopt_wire.messages import State
from gameopt_wire.motion import could_stop

ENDLESS = 3
"""Nobody at all is taken in beyond so many times as many: no junction has so many that cannot stop."""


def can_wait(state: State) -> bool:
    """Whether a vehicle follows no clearance and could come to a stand before its line."""
    return state.accepted is None and could_stop(state.distance_m, state.speed_mps, state.max_decel_mps2)


def refused(newcomers: Iterable[Tracked], excess: int) -> set[str]:
    """The ids of up to `excess` newcomers that can wait: those farthest from their lines."""
    waiting = [each.state for each in newcomers if can_wait(each.state)]
    waiting.sort(key=lambda state: (-state.distance_m, state.vehicle))
    return {state.vehicle for state in waiting[:excess]}
