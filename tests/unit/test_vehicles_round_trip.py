"""Round trips: which command answers which state, and how their times are kept."""

from __future__ import annotations

import numpy as np
import pytest

from gameopt_vehicles.round_trip import RoundTrips
from gameopt_vehicles.timings import Timings


def test_a_command_of_the_state_s_control_cycle_answers_it_and_so_does_a_later_one() -> None:
    trips = RoundTrips()
    trips.asked("a", 7, 1.000)
    trips.asked("b", 7, 1.000)
    trips.answered("a", 6, 1.001)  # the last one's, late
    trips.answered("a", 7, 1.020)
    trips.answered("b", 8, 1.030)
    trips.answered("a", 8, 1.040)  # it does not wait any more
    trips.answered("stranger", 7, 1.050)
    summary = trips.summary()
    assert (summary.count, summary.unanswered) == (2, 0)
    assert (summary.p50_ms, summary.max_ms) == (pytest.approx(20.0, abs=0.11), pytest.approx(30.0))


def test_a_state_is_unanswered_once_the_next_is_put() -> None:
    trips = RoundTrips()
    trips.asked("a", 7, 1.0)
    trips.asked("a", 8, 1.1)
    trips.answered("a", 7, 1.12)  # too late to answer 7, and no answer to 8
    trips.asked("b", 7, 1.0)
    trips.gone("b")
    trips.asked("b", 9, 1.2)
    assert (trips.summary().count, trips.summary().unanswered) == (0, 1)
    trips.restart()
    trips.answered("a", 8, 1.15)
    assert (trips.summary().count, trips.summary().unanswered) == (1, 0)


def test_percentiles_are_known_to_a_tenth_of_a_millisecond() -> None:
    times_s = np.random.default_rng(1).lognormal(-4.0, 0.7, 4999)
    timings = Timings()
    for time_s in times_s:
        timings.observe(float(time_s))
    spread = timings.spread()
    assert spread is not None
    expected = (1e3 * np.percentile(times_s, [50.0, 99.0, 99.9], method="inverted_cdf")).tolist()
    assert [spread.p50_ms, spread.p99_ms, spread.p999_ms] == pytest.approx(expected, abs=0.1001)
    assert spread.max_ms == pytest.approx(1e3 * times_s.max(), abs=5e-4)


def test_memory_is_bounded_by_the_longest_time_and_the_largest_is_exact() -> None:
    timings = Timings()
    for seconds in (-0.001, 0.0, 12.0, 3600.0):
        timings.observe(seconds)
    spread = timings.spread()
    assert spread is not None
    assert (spread.p50_ms, spread.max_ms) == (0.1, 3.6e6)
    assert Timings().spread() is None
