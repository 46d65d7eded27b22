"""Frames of the live page against what the manager said to the vehicles in the same control cycle."""

from __future__ import annotations

import dataclasses
from collections import Counter

import msgspec
import numpy as np
import pytest
from watched import ROADS, STOP_SIGN, options, watch

from gameopt_im.core.interlock import INTRUDING
from gameopt_im.core.parameters import Parameters
from gameopt_im.manager import Outcome
from gameopt_im.sight import Sight
from gameopt_im.web.frames import Car, Frame, frame_of, hello_of
from gameopt_wire.messages import STEP_S, Profile

CYCLES = 120


class Seen:
    """The frames of a run, each beside its control cycle; details of everybody present."""

    def __init__(self, profile: Profile = "default", parameters: Parameters | None = None) -> None:
        self.pairs: list[tuple[Frame, Outcome]] = []
        self._parameters = parameters or Parameters()
        watch(options(profile, parameters), CYCLES, self._see)

    def _see(self, outcome: Outcome, sight: Sight) -> None:
        frame = frame_of(sight, outcome.report, self._parameters, selected=(*sight.snapshot.ids, "nobody"))
        self.pairs.append((frame, outcome))

    def cars(self) -> list[Car]:
        return [car for frame, _ in self.pairs for car in frame.cars]


@pytest.fixture(scope="module")
def seen() -> Seen:
    return Seen()


def test_every_vehicle_is_shown_with_the_turn_slot_and_price_it_was_told(seen: Seen) -> None:
    for frame, outcome in seen.pairs:
        cars = {car.vehicle: car for car in frame.cars}
        assert len(cars) == len(frame.cars) == outcome.report.vehicles
        for command in outcome.commands:
            car = cars[command.vehicle]
            assert (car.rank, car.price) == (command.rank, pytest.approx(command.price, abs=1e-4))
            if car.slot_s is not None:
                assert command.slot_s == pytest.approx(frame.time_s + car.slot_s, abs=0.01)


def test_statuses_follow_the_handshake(seen: Seen) -> None:
    for frame, outcome in seen.pairs:
        status = {car.vehicle: car.status for car in frame.cars}
        for command in outcome.commands:
            if command.clearance is not None:
                assert status[command.vehicle] == "offered"
            if command.cleared is not None:
                assert status[command.vehicle] == "cleared"
        counted = Counter(status.values())
        assert counted["waiting"] + counted["offered"] == outcome.report.uncleared
        assert counted["cleared"] == outcome.report.cleared
    assert {"waiting", "offered", "cleared", "leaving"} <= {car.status for car in seen.cars()}


def test_who_is_in_the_zone_without_a_clearance_is_shown_so() -> None:
    statuses = set()

    def see(outcome: Outcome, sight: Sight) -> None:
        phase = np.full(len(sight.snapshot), INTRUDING)
        frame = frame_of(sight._replace(phase=phase), outcome.report, Parameters())
        statuses.update(car.status for car in frame.cars)

    watch(options(), 2, see, vehicles=4)
    assert statuses == {"intruding"}


def test_the_winner_has_the_least_cost_and_its_order_is_that_of_the_report(seen: Seen) -> None:
    for frame, outcome in seen.pairs:
        assert len(frame.contenders) == outcome.report.candidates
        won = [each for each in frame.contenders if each.won]
        assert [each.number for each in won] == [outcome.report.selected]
        assert won[0].cost == min(each.cost for each in frame.contenders if each.solved)
        vehicles = [frame.cars[i].vehicle for i in won[0].order]
        left = [vehicle for vehicle in outcome.report.order if vehicle in vehicles]
        kept = [vehicle for vehicle in vehicles if vehicle not in outcome.report.granted]
        assert [vehicle for vehicle in left if vehicle in kept] == kept
    assert any(not each.solved for frame, _ in seen.pairs for each in frame.contenders)


def test_details_show_bids_until_the_clearance_and_the_profile_from_then_on(seen: Seen) -> None:
    bidding = driving = 0
    for frame, outcome in seen.pairs:
        assert "nobody" not in frame.details
        offers = {command.vehicle: command.clearance for command in outcome.commands if command.clearance}
        for car in frame.cars:
            detail = frame.details[car.vehicle]
            if car.status == "waiting":
                assert (len(detail.bids), detail.profile_mps, detail.bid) == (8, [], None)
                bidding += 1
            if car.vehicle in offers:
                offer = offers[car.vehicle]
                now = round((frame.time_s - offer.start_s) / STEP_S)
                assert detail.profile_mps == pytest.approx(offer.speeds_mps[now:], abs=0.01)
                assert detail.bid is not None
                driving += 1
    assert bidding
    assert driving


@pytest.mark.parametrize(("profile", "parameters"), [("paper", None), ("default", STOP_SIGN)])
def test_other_profiles_have_frames_too(profile: Profile, parameters: Parameters | None) -> None:
    for frame, outcome in Seen(profile, parameters).pairs:
        assert len(frame.contenders) == outcome.report.candidates
        assert [each.number for each in frame.contenders if each.won] == [outcome.report.selected]
        assert all(each.solved for each in frame.contenders if each.won)


def test_a_frame_is_small(seen: Seen) -> None:
    """Ten a second for everybody who watches: about 120 bytes a vehicle, and little else."""
    for frame, _ in seen.pairs:
        bare = msgspec.structs.replace(frame, details={})
        assert len(msgspec.json.encode(bare)) < 2500 + 130 * len(frame.cars)


def test_the_hello_carries_the_map_and_what_the_candidates_weigh() -> None:
    said = msgspec.json.decode(msgspec.json.encode(hello_of(options(), 7)))
    assert (said["type"], said["term"], said["map"]["intersection"]) == ("hello", 7, ROADS.intersection)
    assert len(said["weights"]) == options().candidates
    few = hello_of(dataclasses.replace(options(), candidates=3), 7)
    assert len(few.weights) == 3
