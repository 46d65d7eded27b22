"""Who solves which jobs of a call: this process takes some itself while its workers are at theirs."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

SENDING = 12.0
"""The weight of a batch's way to a worker and back: what is lighter is done here before an answer could be there.

It takes 0.36 ms, so a weight of 1 is 30 us.
"""


def share_out(weights: Sequence[float], workers: int) -> list[list[int]]:
    """(1 + workers) the places of the jobs that this process and each worker take; `weights` are their durations.

    The heaviest first, each to whoever would have done it soonest (Graham's LPT rule); a worker begins `SENDING` late.
    """
    shares: list[list[int]] = [[] for _ in range(1 + workers)]
    done = [(0.0 if who == 0 else SENDING, who) for who in range(1 + workers)]
    for place in sorted(range(len(weights)), key=lambda place: -weights[place]):
        at, who = heapq.heappop(done)
        shares[who].append(place)
        heapq.heappush(done, (at + weights[place], who))
    return shares
