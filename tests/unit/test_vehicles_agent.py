"""An agent step by step: what it says, which offers it takes, and whom it obeys."""

from __future__ import annotations

import pytest
from vehicles_builders import MOVEMENT, Drive, Seen, offer

from gameopt_wire import motion
from gameopt_wire.messages import STEP_S, Bid, Stranger


def test_a_fresh_command_is_obeyed_within_capabilities() -> None:
    drive = Drive()
    drive.command(speed_mps=15.1)
    assert drive.step().speed_mps == 15.1
    drive.command(speed_mps=20.0)
    assert drive.step().speed_mps == pytest.approx(15.1 + 0.26)
    drive.command(speed_mps=0.0)
    assert drive.step().speed_mps == pytest.approx(15.36 - 0.45)


def test_older_and_duplicate_commands_are_ignored() -> None:
    drive = Drive()
    drive.command(cycle=3, speed_mps=15.2)
    drive.command(cycle=3, speed_mps=14.8)
    drive.command(cycle=2, speed_mps=14.8)
    drive.command(term=0, cycle=9, speed_mps=14.8)
    assert drive.step().speed_mps == 15.2
    drive.command(term=2, cycle=0, speed_mps=15.3)
    assert drive.step().speed_mps == 15.3
    assert drive.state.term == 2


def test_an_older_command_holds_until_it_expires_then_the_vehicle_falls_back() -> None:
    drive = Drive()
    drive.command(speed_mps=14.9)
    for _ in range(6):  # at 0.5 s it still holds
        drive.step()
        assert drive.seen.speed_mps == 14.9
        assert not drive.state.fallback
    assert drive.step().fallback
    assert drive.seen.speed_mps == pytest.approx(14.9 + 0.15)
    assert drive.agent.fallbacks == 1
    drive.command()
    assert not drive.step().fallback


def test_a_newcomer_without_a_command_is_not_yet_abandoned() -> None:
    drive = Drive()
    flags = [drive.step().fallback for _ in range(8)]
    assert flags == [False] * 6 + [True] * 2


@pytest.mark.parametrize("held", [False, True])
def test_without_fresh_commands_it_stops_a_metre_before_the_line(held: bool) -> None:
    drive = Drive(Seen(distance_m=80.0, speed_mps=20.0))
    if held:
        drive.command(speed_mps=20.0, valid_until_s=1000.0)
    for _ in range(300):
        drive.step()
    assert drive.seen.speed_mps == pytest.approx(0.0, abs=0.05)
    # A ballistic step that ends at 0 goes up to b dt^2 / 8 = 6 mm further than braking to a stop within it.
    assert 0.99 <= drive.seen.distance_m < 1.5
    assert drive.state.fallback is not held


def test_past_the_line_uncleared_it_clears_the_junction_at_the_turning_speed() -> None:
    drive = Drive(Seen(distance_m=-1.0, speed_mps=3.0))
    fastest = 0.0
    while drive.seen.distance_m > -30.0:
        drive.step()
        fastest = max(fastest, drive.seen.speed_mps)
    assert 9.0 < fastest <= 10.0
    for _ in range(100):
        drive.step()
    assert drive.seen.speed_mps == pytest.approx(15.0)


def test_turning_speed_can_be_ignored() -> None:
    drive = Drive(Seen(distance_m=-1.0, speed_mps=15.0), turn_speed=False)
    drive.step()
    assert drive.seen.speed_mps > 15.0


def test_the_radar_keeps_it_behind_its_leader() -> None:
    drive = Drive(Seen(speed_mps=15.0, leader_gap_m=17.2, leader_speed_mps=10.0, leader_decel_mps2=4.5))
    allowed = motion.follow_speed(15.2, 15.0, 4.5, 10.0, 4.5, STEP_S)
    assert 14.55 < allowed < 15.15  # less than it would like, more than it can brake
    assert drive.step().speed_mps == allowed


def test_on_the_exit_lane_the_radar_overrules_the_manager_and_gaps_open_gently() -> None:
    close = {"leader_gap_m": 6.0, "leader_speed_mps": 14.0, "leader_decel_mps2": 4.5}
    drive = Drive(Seen(distance_m=-40.0, speed_mps=14.0, **close))
    assert drive.step().speed_mps == pytest.approx(14.0 - 0.15)  # alone: towards 1.3 s, at 1.5 m/s^2
    drive.seen.leader_speed_mps = 0.0
    drive.command(speed_mps=14.0)
    assert drive.step().speed_mps == pytest.approx(14.0 - 0.15 - 0.45)
    drive.seen.speed_mps = slowest = 0.75 * MOVEMENT.exit_speed_mps
    drive.seen.leader_speed_mps, drive.k = slowest, drive.k + 9
    assert drive.step().speed_mps == slowest  # a platoon must not stop itself


def test_tracking_noise_is_seeded() -> None:
    def speeds(seed: int) -> list[float]:
        drive = Drive(seed=seed, noise_mps=0.1)
        result = []
        for _ in range(10):
            drive.command(speed_mps=15.0)
            result.append(drive.step().speed_mps)
        return result

    assert speeds(1) == speeds(1)
    assert speeds(1) != speeds(2)
    assert max(abs(speed - 15.0) for speed in speeds(1)) > 0.01


def test_tracking_noise_does_not_add_up() -> None:
    """Neither on the way up, where every dip would be for good, nor under full brakes."""
    for target, start in ((40.0, 0.0), (0.0, 40.0)):
        drive = Drive(Seen(distance_m=4000.0, speed_mps=start, max_speed_mps=60.0), noise_mps=0.2)
        off = []
        for k in range(1, 80):
            drive.command(speed_mps=target)
            drive.step()
            exact = start + STEP_S * k * (2.6 if target > start else -4.5)
            off.append(drive.seen.speed_mps - exact)
        assert abs(sum(off) / len(off)) < 0.1
        assert 0.15 < (sum(error**2 for error in off) / len(off)) ** 0.5 < 0.25


def test_bids_come_at_entry_every_second_and_when_they_change_until_cleared() -> None:
    factor = [0.5]
    drive = Drive(strategy=lambda preference: preference.scaled(factor[0]))
    bids: list[Bid] = []
    for _ in range(25):
        if drive.time_s == 1.5:
            factor[0] = 0.6
        if (bid := drive.agent.bid(drive.time_s)) is not None:
            bids.append(bid)
        drive.command(speed_mps=10.0)
        drive.step()
    assert [bid.time_s for bid in bids] == [0.0, 1.0, 1.5]  # then 2.5, but for what follows
    assert bids[0].assertiveness == bids[1].assertiveness < bids[2].assertiveness
    drive.command(clearance=offer(drive))
    drive.step()
    assert drive.agent.bid(drive.time_s) is None


def test_a_vehicle_whose_aggressiveness_is_given_bids_by_it() -> None:
    for aggressiveness, assertiveness in ((0.0, 1.0), (0.5, 3.0), (1.0, 5.0)):
        bid = Drive(aggressiveness=aggressiveness).agent.bid(0.0)
        assert bid is not None
        assert bid.assertiveness == assertiveness


def test_a_leader_overrules_every_command_and_a_stranger_is_told_to_the_manager() -> None:
    stranger = {"leader_gap_m": 17.2, "leader_speed_mps": 10.0, "leader_decel_mps2": 4.5, "leader_strange": True}
    drive = Drive(Seen(speed_mps=15.0, **stranger))
    assert drive.state.stranger == Stranger(gap_m=17.2, speed_mps=10.0, decel_mps2=4.5)
    assert drive.state.leader_gap_m is None  # it is no vehicle that the manager should know
    drive.command(speed_mps=15.2)
    assert drive.step().speed_mps == motion.follow_speed(15.2, 15.0, 4.5, 10.0, 4.5, STEP_S)
    drive.seen.leader_strange = False
    limit = motion.follow_speed(15.2, drive.seen.speed_mps, 4.5, 10.0, 4.5, STEP_S)
    drive.command(speed_mps=15.2)
    state = drive.step()
    assert (state.speed_mps, state.stranger, state.leader_gap_m) == (limit, None, 17.2)


def test_no_command_takes_an_uncleared_vehicle_past_the_point_of_no_return() -> None:
    """The manager may have sent it on the strength of an old state."""
    drive = Drive(Seen(distance_m=26.5, speed_mps=15.0), setback_m=0.5)  # 25 m to a stand, 1.5 m before the line
    drive.command(speed_mps=15.2)
    assert drive.step().speed_mps == motion.stop_speed(26.0, 15.0, 4.5, STEP_S) < 15.0
