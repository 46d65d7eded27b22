"""What a measured change makes of a claimed one: reproduced, not reproduced, or not decided by these seeds."""

from __future__ import annotations

import math

from gameopt_sumo.compare.results import Figure

FLAT = 0.05
"""What changes by less than this share is unaffected."""
NEAR = 0.1
"""Where the paper says `around`: what is left after the change (ours over theirs) may be off by this share."""
CLOSE = 0.25
"""A method's own change is reproduced if it is within this share of the claimed one."""
NO_DATA, REPRODUCED, UNDECIDED = "no data", "reproduced", "not decided"
MISSED = "not reproduced"


def inside(found: Figure, low: float, high: float) -> bool | None:
    """Whether a figure lies within these bounds; None where its 95 % interval has a bound in it.

    Without an interval, from a single seed, the mean alone decides.
    """
    half = found.half or 0.0
    if low <= found.mean - half and found.mean + half <= high:
        return True
    return False if found.mean + half < low or found.mean - half > high else None


def remainder(found: float, claimed: float) -> float:
    """What is left after the change over what the claim leaves: 1.1 at a claimed -70 % is 0.33 left instead of 0.30."""
    return (1.0 + found) / (1.0 + claimed)


def over_another(found: Figure | None, claimed: float, at_least: bool) -> str:
    """Ours against another: the claimed change or more of it, up to `NEAR` less where the paper says `around`."""
    if found is None:
        return NO_DATA
    slack = 0.0 if at_least else NEAR
    if claimed > 0.0:
        low, high = (1.0 + claimed) * (1.0 - slack) - 1.0, math.inf
    else:
        low, high = -math.inf, (1.0 + claimed) * (1.0 + slack) - 1.0
    missed = "the other way" if found.mean * claimed < 0.0 else "smaller"
    if abs(found.mean / claimed) < 0.005:
        missed = "no change"
    return _said(inside(found, low, high), missed)


def over_itself(found: Figure | None, claimed: float) -> str:
    """A method against itself: about the claimed change, neither more nor less; a claimed 0 is `unperturbed`."""
    if found is None:
        return NO_DATA
    if claimed == 0.0:
        return _said(inside(found, -FLAT, FLAT), "it changes")
    bounds = sorted((claimed * (1.0 - CLOSE), claimed * (1.0 + CLOSE)))
    missed = "smaller" if abs(found.mean) < abs(claimed) else "larger"
    if found.mean * claimed <= 0.0:
        missed = "the other way"
    return _said(inside(found, *bounds), missed)


def below_ms(median: Figure, slow: Figure, limit_ms: float) -> str:
    """Times that are claimed to stay below a limit: by median and 99th percentile."""
    both = inside(slow, -math.inf, limit_ms)
    if both is False and inside(median, -math.inf, limit_ms):
        return "the median only"
    return {True: REPRODUCED, False: MISSED, None: UNDECIDED}[both]


def _said(reproduced: bool | None, missed: str) -> str:
    if reproduced is None:
        return UNDECIDED
    return REPRODUCED if reproduced else f"{MISSED}: {missed}"
