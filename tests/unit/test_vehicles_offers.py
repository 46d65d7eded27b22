"""Which clearances an agent takes, and how it keeps to the one it has taken."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Any

import pytest
from vehicles_builders import Drive, Seen, offer


def test_an_accepted_clearance_is_tracked_exactly_whatever_is_commanded() -> None:
    drive = Drive()
    clearance = offer(drive)
    drive.command(clearance=clearance, speed_mps=0.0)
    covered = list(accumulate(0.05 * (a + b) for a, b in pairwise(clearance.speeds_mps)))
    for k in range(1, 40):
        state = drive.step()
        assert (state.accepted, state.term, state.fallback) == (5, 1, False)
        assert state.speed_mps == clearance.speeds_mps[k]
        assert state.distance_m == pytest.approx(100.0 - covered[k - 1], abs=1e-9)
        repetition = {"clearance": clearance} if k < 39 else {}
        drive.command(speed_mps=18.8, **repetition)
    assert drive.step().speed_mps == 18.8  # the profile has ended
    assert drive.state.accepted == 5  # but the vehicle has not passed


def test_acceptance_lasts_until_the_profile_has_ended_and_the_rear_has_passed() -> None:
    drive = Drive(Seen(distance_m=10.0, speed_mps=10.0))
    drive.command(clearance=offer(drive, speeds_mps=[10.0] * 30))
    for _ in range(39):  # the profile ends after 29 steps, the rear has passed after 40
        assert drive.step().accepted == 5
        drive.command(speed_mps=10.0)
    drive.step()
    assert drive.state.accepted is None


def test_an_accepted_clearance_outlives_its_manager() -> None:
    drive = Drive()
    clearance = offer(drive)
    drive.command(clearance=clearance)
    drive.step()
    drive.command(term=2, cycle=0, speed_mps=0.0)
    state = drive.step()
    assert (state.accepted, state.term) == (5, 1)
    for _ in range(30):  # and no command at all
        assert not drive.step().fallback
    assert drive.seen.speed_mps == clearance.speeds_mps[32]


def test_a_second_offer_does_not_replace_the_first() -> None:
    drive = Drive()
    drive.command(clearance=offer(drive))
    drive.step()
    drive.command(clearance=offer(drive, number=6, speeds_mps=[15.0] * 40))
    assert drive.step().accepted == 5


@pytest.mark.parametrize(
    ("fields", "taken"),
    [
        ({}, True),
        ({"expires_s": 0.29}, False),
        ({"expires_s": 0.31}, True),
        ({"speeds_mps": [15.8] * 40}, True),  # 0.24 m behind after 0.3 s, and 0.12 m more until it is as fast
        ({"speeds_mps": [16.0] * 40}, False),
        ({"speeds_mps": [14.1] * 40}, True),
        ({"speeds_mps": [13.75] * 40}, False),
    ],
)
def test_a_late_offer_is_taken_only_unexpired_and_if_it_can_be_kept_to(fields: dict[str, Any], taken: bool) -> None:
    drive = Drive()
    clearance = offer(drive, **({"speeds_mps": [15.0] * 40} | fields))
    for _ in range(3):
        drive.command(speed_mps=15.0)
        drive.step()
    drive.command(speed_mps=15.0, clearance=clearance)
    assert (drive.step().accepted == 5) is taken


@pytest.mark.parametrize(("push_m", "taken"), [(0.15, True), (0.25, False), (-0.15, True), (-0.25, False)])
def test_a_late_offer_is_taken_only_within_forty_centimetres(push_m: float, taken: bool) -> None:
    drive = Drive()
    clearance = offer(drive, speeds_mps=[15.0] * 40)
    for _ in range(2):
        drive.command(speed_mps=15.0)
        drive.step(push_m=push_m)
    drive.command(speed_mps=15.0, clearance=clearance)
    assert (drive.step().accepted == 5) is taken


@pytest.mark.parametrize(("speed", "accel", "taken"), [(16.15, 2.6, True), (16.25, 2.6, False), (16.15, 1.0, False)])
def test_an_offer_is_taken_only_at_a_speed_that_the_vehicle_soon_has(speed: float, accel: float, taken: bool) -> None:
    drive = Drive(Seen(max_accel_mps2=accel))
    drive.command(clearance=offer(drive, speeds_mps=[speed] * 40))
    assert (drive.step().accepted == 5) is taken


def test_an_offer_once_refused_stays_refused() -> None:
    drive = Drive()
    drive.command(clearance=offer(drive, speeds_mps=[18.0] * 40))
    drive.step()
    drive.command(clearance=offer(drive))
    assert drive.step().accepted is None
    drive.command(clearance=offer(drive, number=6))
    assert drive.step().accepted == 6


def test_an_offer_that_starts_later_is_decided_then_unless_the_manager_has_changed() -> None:
    for term, accepted in ((1, 5), (2, None)):
        drive = Drive()
        later = offer(drive, start_s=0.2, expires_s=0.6, speeds_mps=[15.0] * 40)
        drive.command(speed_mps=15.0, clearance=later)
        assert drive.step().accepted is None
        drive.command(term=term, speed_mps=15.0)
        assert drive.step().accepted is None
        assert drive.step().accepted == accepted


def test_an_offer_older_than_its_memory_is_refused() -> None:
    drive = Drive()
    drive.k = 50
    drive.command(clearance=offer(drive, start_s=3.0, expires_s=6.0, speeds_mps=[15.0] * 40))
    assert drive.step().accepted is None


def test_drift_off_the_profile_is_corrected_gently() -> None:
    drive = Drive()
    drive.command(clearance=offer(drive, speeds_mps=[15.0] * 100))
    drive.step(push_m=0.5)
    assert drive.step().speed_mps == pytest.approx(15.25)
    for _ in range(60):
        drive.step()
    assert drive.seen.distance_m == pytest.approx(100.0 - 62 * 1.5, abs=0.06)


def taken(start: Seen) -> Drive:
    """A vehicle at 15 m/s on clearance 5."""
    drive = Drive(start)
    drive.command(speed_mps=15.0, clearance=offer(drive, speeds_mps=[15.0] * 40))
    assert drive.step().accepted == 5
    return drive


def test_a_clearance_asked_back_is_dropped_and_the_command_holds() -> None:
    drive = taken(Seen(distance_m=60.0))
    drive.command(speed_mps=14.6, withdrawn=5)
    assert drive.step().accepted is None
    assert drive.seen.speed_mps == 14.6
    drive.command(speed_mps=14.6, clearance=offer(drive, speeds_mps=[14.6] * 40))
    assert drive.step().accepted is None  # a repetition that came late


def test_who_cannot_stop_any_more_keeps_it() -> None:
    drive = taken(Seen(distance_m=27.0))  # 25 m to a stand, and 1 m before the line
    drive.command(speed_mps=14.6, withdrawn=5)
    assert drive.step().accepted == 5
    assert drive.seen.speed_mps == 15.0


@pytest.mark.parametrize("fields", [{"withdrawn": 6}, {"withdrawn": 5, "term": 2}])
def test_only_its_own_clearance_is_dropped(fields: dict[str, int]) -> None:
    drive = taken(Seen(distance_m=60.0))
    drive.command(speed_mps=14.6, **fields)
    assert drive.step().accepted == 5
