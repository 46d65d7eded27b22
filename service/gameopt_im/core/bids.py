"""Priority assignment and the master bid: class, declared assertiveness and state become one number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gameopt_im.core.parameters import Auction, VehicleClass
from gameopt_im.core.snapshot import Floats

DEFAULT_CLASS = "passenger"
"""What a vehicle of a class that is not configured counts as."""


class Priority(NamedTuple):
    """What a declared bid comes to within the bounds of its class; all without unit."""

    assertiveness: float
    speed: float
    variation: float


def class_bounds(classes: Mapping[str, VehicleClass], name: str) -> VehicleClass:
    """The bounds of a class; one that is not configured has those of a passenger car."""
    return classes.get(name) or classes.get(DEFAULT_CLASS) or VehicleClass()


def assign(bounds: VehicleClass, declared: float) -> Priority:
    """The paper's priority assignment: A clipped to the class's range, Ps and Pv linear between their bounds.

    The preference is read off the declared bid, (A - A_lo) / (A_hi - A_lo): what is private stays private.
    """
    low, high = bounds.assertiveness
    assertiveness = min(max(declared, low), high)
    share = (assertiveness - low) / (high - low) if high > low else 0.0
    return Priority(assertiveness, _between(bounds.speed_priority, share), _between(bounds.variation_priority, share))


def _between(bounds: tuple[float, float], share: float) -> float:
    return bounds[0] + share * (bounds[1] - bounds[0])


def features(s: Floats, v: Floats, waited: Floats, assertiveness: Floats, auction: Auction) -> Floats:
    """(n, 4) bidding currencies T, D, W, A, each divided by its bound so that the weights compare.

    T = c1 - tau with tau = s / max(v, v_min), clipped to [0, c1]; D = c2 - s, clipped to [0, c2]; W the time
    since zone entry; A the assertiveness. `s` in m (negative past the line), `v` in m/s, `waited` in s.
    """
    c1, c2 = auction.time_bound_s, auction.distance_bound_m
    tau = s / np.maximum(v, auction.min_speed_mps)
    return np.stack(
        [
            np.clip(c1 - tau, 0.0, c1) / c1,
            np.clip(c2 - s, 0.0, c2) / c2,
            waited / auction.waiting_bound_s,
            assertiveness / auction.assertiveness_bound,
        ],
        axis=1,
    )


def master_bids(features: Floats, weights: Sequence[Sequence[float]]) -> Floats:
    """(K, n) master bids omega^T f (`eq: master_bid`) for K weight vectors over (n, 4) features.

    Summed currency by currency, not by a matrix product: its result may differ in the last bit by machine.
    """
    omega = np.asarray(weights, dtype=np.float64).reshape(-1, features.shape[1])
    bids = np.zeros((len(omega), len(features)))
    for currency in range(features.shape[1]):
        bids += omega[:, currency, None] * features[None, :, currency]
    return bids


def with_waiting(bids: Floats, waited: Floats, multiplier: float) -> Floats:
    """(K, n) bids times Carlino's waiting reward 1 + m w, with m in 1/s and w in s."""
    return bids * (1.0 + multiplier * waited)
