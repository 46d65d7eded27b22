"""Injected faults are seeded, and exact in time."""

from __future__ import annotations

import pytest

from gameopt_vehicles.faults import Faults


def sent(faults: Faults[int], count: int) -> dict[int, float]:
    """When each of `count` messages, one per step, arrives."""
    arrivals = {}
    for k in range(count + 100):
        if k < count:
            faults.push(k / 10, k)
        arrivals |= dict.fromkeys(faults.due(k / 10), k / 10)
    return arrivals


def test_without_faults_messages_pass_in_order() -> None:
    faults: Faults[int] = Faults(1)
    for k in range(5):
        faults.push(0.0, k)
    assert faults.due(0.0) == [0, 1, 2, 3, 4]
    assert faults.due(10.0) == []
    assert faults.lost == 0


def test_loss_is_counted_and_seeded() -> None:
    faults = Faults[int](1, loss=0.3)
    arrived = sent(faults, 2000)
    assert faults.lost == 2000 - len(arrived)
    assert faults.lost == pytest.approx(600, abs=60)
    assert arrived == sent(Faults[int](1, loss=0.3), 2000)
    assert arrived != sent(Faults[int](2, loss=0.3), 2000)


def test_delay_moves_every_message_by_whole_steps() -> None:
    arrived = sent(Faults[int](1, delay_s=0.3), 200)
    assert len(arrived) == 200
    assert all(time_s == (k + 3) / 10 for k, time_s in arrived.items())


def test_jitter_spreads_and_reorders_but_never_delivers_early() -> None:
    arrived = sent(Faults[int](1, delay_s=0.1, jitter_s=0.3), 500)
    lags = [time_s - k / 10 for k, time_s in arrived.items()]
    assert -1e-9 <= min(lags) < 0.05
    assert 0.3 < max(lags) <= 0.5
    assert list(arrived) != sorted(arrived)


def test_the_next_arrival_is_known() -> None:
    faults: Faults[int] = Faults(1, delay_s=0.25)
    assert faults.next_due_s() is None
    faults.push(1.0, 1)
    assert faults.next_due_s() == 1.25
