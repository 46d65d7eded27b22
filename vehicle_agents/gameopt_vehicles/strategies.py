"""What a vehicle wants, and what it says it wants.

The aggressiveness d is private: it is drawn here, stays inside the agent, and only the assertiveness that a
strategy makes of it is ever bid.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

ASSERTIVENESS: dict[str, tuple[float, float]] = {
    "passenger": (1.0, 5.0),
    "truck": (3.0, 6.0),
    "bus": (3.0, 7.0),
    "emergency": (7.0, 10.0),
}
"""Lowest and highest assertiveness A per class, the manager's defaults; any other class bids as passenger."""

AGGRESSIVENESS_BETA = (2.0, 2.0)
"""Shape of the distribution of d on [0, 1]: most drivers are in the middle, few at the ends."""


@dataclass(frozen=True, slots=True)
class Preference:
    """A vehicle's private aggressiveness d in [0, 1] and the public range of assertiveness of its class."""

    aggressiveness: float = field(repr=False)  # private: not even a log line shows it
    lowest: float
    highest: float

    def scaled(self, factor: float) -> float:
        """The assertiveness of a vehicle whose d were `factor` times its own, within the class's range."""
        share = min(1.0, max(0.0, factor * self.aggressiveness))
        return self.lowest + share * (self.highest - self.lowest)


Strategy = Callable[[Preference], float]
"""What to bid, given what one wants."""


def truthful(preference: Preference) -> float:
    """A = A_lo + d (A_hi - A_lo): the bid that the auction rewards."""
    return preference.scaled(1.0)


def shade(factor: float) -> Strategy:
    """Bid as if d were `factor` times what it is: below 1 understates, above 1 overstates."""
    return lambda preference: preference.scaled(factor)


def overbid(preference: Preference) -> float:
    """Always bid the most the class allows."""
    return preference.highest


def strategy_named(name: str) -> Strategy:
    """The strategy behind `truthful`, `overbid` or `shade:FACTOR`; raises `ValueError` for anything else."""
    if name == "truthful":
        return truthful
    if name == "overbid":
        return overbid
    kind, _, factor = name.partition(":")
    try:
        value = float(factor)
    except ValueError:
        value = -1.0
    if kind != "shade" or not 0.0 <= value <= 100.0:
        raise ValueError(f"{name!r} is not a strategy; allowed: truthful, overbid, shade:FACTOR (0 to 100)")
    return shade(value)


def generator(seed: int, vehicle: str, purpose: int) -> np.random.Generator:
    """A random stream of its own per vehicle and purpose, whatever the order in which vehicles arrive."""
    own = hashlib.sha256(vehicle.encode()).digest()
    return np.random.default_rng([seed, purpose, int.from_bytes(own[:16], "big")])


def preference_of(seed: int, vehicle: str, vehicle_class: str, aggressiveness: float | None = None) -> Preference:
    """The preference that vehicle has under that seed; `aggressiveness` replaces the drawn one."""
    lowest, highest = ASSERTIVENESS.get(vehicle_class, ASSERTIVENESS["passenger"])
    if aggressiveness is None:
        aggressiveness = float(generator(seed, vehicle, 0).beta(*AGGRESSIVENESS_BETA))
    return Preference(aggressiveness, lowest, highest)
