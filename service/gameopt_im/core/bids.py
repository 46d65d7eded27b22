"""Priority assignment and the master bid: class, declared assertiveness and state become one number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gameopt_im.core.kinematics import kernel
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
    return _features(
        s, v, waited, assertiveness, auction.time_bound_s, auction.distance_bound_m, auction.min_speed_mps,
        auction.waiting_bound_s, auction.assertiveness_bound,
    )  # fmt: skip


@kernel
def _features(
    s: Floats,
    v: Floats,
    waited: Floats,
    assertiveness: Floats,
    c1: float,
    c2: float,
    slowest: float,
    w: float,
    a: float,
) -> Floats:
    out = np.empty((s.shape[0], 4))
    for i in range(s.shape[0]):
        tau = s[i] / max(v[i], slowest)
        out[i, 0] = min(max(c1 - tau, 0.0), c1) / c1
        out[i, 1] = min(max(c2 - s[i], 0.0), c2) / c2
        out[i, 2], out[i, 3] = waited[i] / w, assertiveness[i] / a
    return out


def master_bids(features: Floats, weights: Sequence[Sequence[float]]) -> Floats:
    """(K, n) master bids omega^T f (`eq: master_bid`) for K weight vectors over (n, 4) features.

    Summed currency by currency, not by a matrix product: its result may differ in the last bit by machine.
    """
    return _weighed(features, np.asarray(weights, dtype=np.float64).reshape(-1, features.shape[1]))


@kernel
def _weighed(features: Floats, omega: Floats) -> Floats:
    bids = np.zeros((omega.shape[0], features.shape[0]))
    for k in range(omega.shape[0]):
        for i in range(features.shape[0]):
            for currency in range(features.shape[1]):
                bids[k, i] += omega[k, currency] * features[i, currency]
    return bids


def with_waiting(bids: Floats, waited: Floats, multiplier: float) -> Floats:
    """(K, n) bids times Carlino's waiting reward 1 + m w, with m in 1/s and w in s."""
    return bids * (1.0 + multiplier * waited)
