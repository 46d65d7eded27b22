"""Who is not taken in where there are more vehicles than the manager answers for: pure functions of their states.

Whoever is refused gets no commands, so it stops before its line by itself, and the vehicle behind it, whose radar sees
somebody the manager does not know, gets no clearance. A newcomer that may have to cross is not refused: one that says
it follows a clearance, has passed its line, or cannot stop before it.
"""

from __future__ import annotations

from collections.abc import Iterable

from gameopt_im.core.snapshot import NONE
from gameopt_im.tracked import Said, Tracked
from gameopt_wire.motion import could_stop

ENDLESS = 3
"""Nobody at all is taken in beyond so many times as many: no junction has so many that cannot stop."""


def can_wait(said: Said) -> bool:
    """Whether a vehicle follows no clearance and could come to a stand before its line."""
    return said.accepted == NONE and could_stop(said.s, said.v, said.b_max)


def refused(newcomers: Iterable[Tracked], excess: int) -> set[str]:
    """The ids of up to `excess` newcomers that can wait: those farthest from their lines."""
    waiting = [(-each.last.s, each.name) for each in newcomers if can_wait(each.last)]
    return {name for _, name in sorted(waiting)[:excess]}
