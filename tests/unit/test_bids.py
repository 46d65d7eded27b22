"""Priority assignment, features and master bids."""

from __future__ import annotations

import numpy as np
import pytest

from gameopt_im.core.bids import Priority, assign, class_bounds, features, master_bids, with_waiting
from gameopt_im.core.parameters import Auction, Parameters, VehicleClass

TRUCK = VehicleClass(assertiveness=(3.0, 6.0), speed_priority=(0.8, 1.2), variation_priority=(3.0, 2.0))


@pytest.mark.parametrize(
    ("declared", "wanted"),
    [
        (3.0, Priority(3.0, 0.8, 3.0)),
        (6.0, Priority(6.0, 1.2, 2.0)),
        (4.5, Priority(4.5, 1.0, 2.5)),
        (0.0, Priority(3.0, 0.8, 3.0)),
        (99.0, Priority(6.0, 1.2, 2.0)),
    ],
)
def test_the_declared_bid_picks_the_point_within_the_class_bounds(declared: float, wanted: Priority) -> None:
    np.testing.assert_allclose(assign(TRUCK, declared), wanted)


def test_a_class_with_one_point_has_no_share_to_declare() -> None:
    assert assign(VehicleClass(assertiveness=(4.0, 4.0)), 9.0) == Priority(4.0, 0.8, 1.2)


def test_an_unknown_class_counts_as_a_passenger_car() -> None:
    classes = Parameters().classes
    assert class_bounds(classes, "truck") is classes["truck"]
    assert class_bounds(classes, "hovercraft") is classes["passenger"]
    assert class_bounds({}, "hovercraft") == VehicleClass()


def test_emergency_vehicles_bid_above_passenger_cars_whatever_they_declare() -> None:
    classes = Parameters().classes
    assert assign(classes["emergency"], 0.0).assertiveness > assign(classes["passenger"], 100.0).assertiveness


def test_features_by_hand() -> None:
    made = features(
        s=np.array([50.0, 150.0, 75.0]),
        v=np.array([10.0, 10.0, 0.0]),
        waited=np.array([0.0, 15.0, 60.0]),
        assertiveness=np.array([5.0, 1.0, 10.0]),
        auction=Auction(),
    )
    wanted = [
        [10 / 15, 100 / 150, 0.0, 0.5],
        [0.0, 0.0, 0.5, 0.1],
        [0.0, 75 / 150, 2.0, 1.0],  # a standing vehicle counts as one at v_min: tau = 75 s, beyond c1
    ]
    np.testing.assert_allclose(made, wanted)


def test_time_and_distance_stay_between_none_and_all() -> None:
    none = np.zeros(3)
    made = features(np.array([-30.0, 0.0, 5_000.0]), np.array([20.0, 0.0, 1.0]), none, none, Auction())
    assert made[:, :2].tolist() == [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]]


def test_a_master_bid_is_the_weighted_sum_of_the_features() -> None:
    rng = np.random.default_rng(2)
    made, weights = rng.random((7, 4)), rng.random((3, 4))
    np.testing.assert_allclose(master_bids(made, weights.tolist()), weights @ made.T)
    assert master_bids(np.zeros((0, 4)), weights.tolist()).shape == (3, 0)


def test_waiting_multiplies_the_bid() -> None:
    bids = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_allclose(with_waiting(bids, np.array([0.0, 10.0]), 0.1), [[1.0, 4.0], [3.0, 8.0]])
    np.testing.assert_array_equal(with_waiting(bids, np.array([0.0, 10.0]), 0.0), bids)
