"""What a control cycle leaves for those who watch: references to what it made anyway, nothing worked out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from gameopt_im.core.decision import Conclusion, Winner
from gameopt_im.core.planning import Bidders
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Ints, Snapshot
from gameopt_im.solver.horizon_job import HorizonOutcome
from gameopt_im.solver.jobs import Outcome
from gameopt_im.strategy import Proposal
from gameopt_im.tracked import Tracked


class Sight(NamedTuple):
    """One control cycle, to be read before the next one begins: the book changes, and `tracked` asks the tracker.

    `phase` (n,) is the interlock's of each vehicle of the snapshot; `results` are in the order of the candidates,
    None for a program that was not solved.
    """

    snapshot: Snapshot
    phase: Ints
    book: Book
    who: Bidders
    proposal: Proposal
    results: Sequence[Outcome | HorizonOutcome | None]
    winner: Winner | None
    concluded: Conclusion
    tracked: Callable[[str], Tracked | None]
