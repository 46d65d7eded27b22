"""Private preferences and what strategies make of them."""

from __future__ import annotations

import pytest

from gameopt_vehicles.strategies import (
    ASSERTIVENESS,
    Preference,
    overbid,
    preference_of,
    shade,
    strategy_named,
    truthful,
)


def test_truthful_is_linear_in_the_class_range() -> None:
    assert truthful(Preference(0.25, 1.0, 5.0)) == 2.0
    assert shade(2.0)(Preference(0.25, 1.0, 5.0)) == 3.0
    assert shade(8.0)(Preference(0.25, 1.0, 5.0)) == 5.0
    assert overbid(Preference(0.25, 1.0, 5.0)) == 5.0


@pytest.mark.parametrize("vehicle_class", [*ASSERTIVENESS, "tram"])
def test_bids_stay_in_the_class_range_and_differ_between_vehicles(vehicle_class: str) -> None:
    lowest, highest = ASSERTIVENESS.get(vehicle_class, ASSERTIVENESS["passenger"])
    bids = {truthful(preference_of(1, f"v{k}", vehicle_class)) for k in range(200)}
    assert len(bids) == 200
    assert lowest <= min(bids) < max(bids) <= highest
    assert sum(bids) / 200 == pytest.approx((lowest + highest) / 2, rel=0.05)


def test_a_preference_depends_on_seed_and_vehicle_alone() -> None:
    assert preference_of(1, "a", "truck") == preference_of(1, "a", "truck")
    assert preference_of(1, "a", "truck") != preference_of(2, "a", "truck")
    assert preference_of(1, "a", "truck") != preference_of(1, "b", "truck")


def test_a_given_preference_replaces_the_drawn_one_within_the_class_range() -> None:
    given = preference_of(1, "a", "truck", 0.25)
    assert given.aggressiveness == 0.25
    assert truthful(given) == 3.75
    assert preference_of(1, "a", "taxi", 1.0).highest == ASSERTIVENESS["passenger"][1]


def test_a_preference_does_not_show_in_a_log_line() -> None:
    preference = preference_of(1, "a", "truck")
    assert str(preference.aggressiveness) not in repr(preference)


@pytest.mark.parametrize("name", ["greedy", "shade", "shade:", "shade:-1", "shade:nan", "shade:x"])
def test_an_unknown_strategy_says_what_is_allowed(name: str) -> None:
    with pytest.raises(ValueError, match="truthful, overbid, shade:FACTOR"):
        strategy_named(name)


def test_strategies_by_name() -> None:
    assert strategy_named("truthful") is truthful
    assert strategy_named("overbid") is overbid
    assert strategy_named("shade:0.5")(Preference(0.5, 1.0, 5.0)) == 2.0
