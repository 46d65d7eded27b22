"""One vehicle: what it says of itself, what it bids, and how it drives. Pure: no I/O, no clock, no network.

Each step goes: `observe` (a `State` to publish), `bid`, `receive` any number of commands, then `act` (the
speed for the next step). In order of precedence a vehicle follows

1. its accepted clearance until its rear stands clear, even if the manager that gave it is gone: exactly, unless
   this step's command is slower, or, without one, its own radar says that the leader has braked;
2. the command for this very step;
3. an older command that still holds, capped by its own sensors under the rules of motion;
4. with none of these, its fallback: gently on under the same rules, so it stops before the line.

A clearance is an offer, looked at once. It is taken if it has not expired and the vehicle is still on its
profile; an offer that was once refused stays refused, since the manager may have given its place away.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from gameopt_vehicles import driving
from gameopt_vehicles.profile import SpeedProfile
from gameopt_vehicles.road import Observation
from gameopt_vehicles.strategies import Preference, Strategy, generator, preference_of, truthful
from gameopt_wire.intersection import Lane, Movement
from gameopt_wire.messages import STEP_S, Bid, Clearance, Command, State, Stranger

OFFER_DISTANCE_M = 0.4
OFFER_SPEED_MPS = 1.2
"""How far off an offered profile a vehicle may be and still take it; the way it may never be off it afterwards."""
BID_REPEAT_S = 1.0
"""A bid is repeated this often while it matters, in case one was lost."""
NEWCOMER_S = 0.5
"""A vehicle that has just appeared does not count as abandoned before this."""
HISTORY_STEPS = 30
UNTRACKED = 6.0
"""No tracking error is this many sigma."""
SAME_TIME_S = 0.5 * STEP_S
"""Times closer than this are the same step."""


class _Moment(NamedTuple):
    time_s: float
    distance_m: float


class _Accepted(NamedTuple):
    id: int
    term: int
    profile: SpeedProfile
    start_distance_m: float


class Agent:
    """An independent vehicle; `seed` and its id fix its private preference and its tracking noise.

    `aggressiveness` replaces the drawn preference. `setback_m` is the map's, for its movement and size: it waits
    that much further upstream.
    """

    def __init__(
        self,
        first: Observation,
        movement: Movement,
        lane: Lane,
        *,
        seed: int,
        setback_m: float = 0.0,
        strategy: Strategy = truthful,
        aggressiveness: float | None = None,
        turn_speed: bool = True,
        noise_mps: float = 0.0,
    ) -> None:
        self.vehicle = first.vehicle
        self.fallback = False
        self.fallbacks = 0
        self._movement = movement
        self._lane = lane
        self._setback_m = setback_m
        self._turn_speed = turn_speed
        self._strategy = strategy
        self._preference: Preference = preference_of(seed, first.vehicle, first.vehicle_class, aggressiveness)
        self._noise_mps = noise_mps
        self._random = generator(seed, first.vehicle, 1) if noise_mps > 0.0 else None
        self._aim_mps = first.speed_mps
        self._history: deque[_Moment] = deque(maxlen=HISTORY_STEPS)
        self._newcomer_until_s: float | None = None
        self._bid: Bid | None = None
        self._command: Command | None = None
        self._last = (-1, -1)
        self._offer: tuple[int, Clearance] | None = None
        self._seen_offers: set[tuple[int, int]] = set()
        self._accepted: _Accepted | None = None

    def observe(self, seen: Observation, time_s: float) -> State:
        """Take in what the sensors say at `time_s` and put it into words for the manager."""
        if self._newcomer_until_s is None:
            self._newcomer_until_s = time_s + NEWCOMER_S
        self._history.append(_Moment(time_s, seen.distance_m))
        accepted = self._accepted
        if accepted is not None and self._is_past(seen):
            self._accepted = accepted = None
        return State(
            vehicle=self.vehicle,
            time_s=time_s,
            movement=seen.movement,
            distance_m=seen.distance_m,
            speed_mps=max(0.0, seen.speed_mps),
            acceleration_mps2=seen.acceleration_mps2,
            length_m=seen.length_m,
            width_m=seen.width_m,
            vehicle_class=seen.vehicle_class,
            max_speed_mps=seen.max_speed_mps,
            max_accel_mps2=seen.max_accel_mps2,
            max_decel_mps2=seen.max_decel_mps2,
            term=accepted.term if accepted else max(0, self._last[0]),
            accepted=accepted.id if accepted else None,
            fallback=self.fallback,
            stranger=_stranger(seen),
            leader_gap_m=None if seen.leader_strange else seen.leader_gap_m,
        )

    def bid(self, time_s: float) -> Bid | None:
        """The bid to send at `time_s`: the first, a changed one, or a repetition; none once it is cleared."""
        if self._accepted is not None or self._history[-1].distance_m <= 0.0:
            return None
        assertiveness = self._strategy(self._preference)
        last = self._bid
        if (
            last is not None
            and last.assertiveness == assertiveness
            and time_s - last.time_s < BID_REPEAT_S - SAME_TIME_S
        ):
            return None
        self._bid = Bid(vehicle=self.vehicle, time_s=time_s, assertiveness=assertiveness)
        return self._bid

    def receive(self, command: Command) -> None:
        """Take in a command, unless one at least as new is already there (duplicates, reordering)."""
        if (command.term, command.cycle) <= self._last:
            return
        self._last = (command.term, command.cycle)
        self._command = command
        if command.clearance is not None:
            self._offer = (command.term, command.clearance)
        elif self._offer is not None and self._offer[0] < command.term:
            self._offer = None  # the new manager knows nothing of its predecessor's open offers

    def act(self, seen: Observation, time_s: float) -> float:
        """The speed to have at `time_s + STEP_S`; also decides on an offer."""
        self._consider_offer(seen, time_s)
        self._consider_withdrawal(seen)
        accepted = self._accepted
        if accepted is not None and not accepted.profile.ended(time_s):
            self.fallback = False
            speed = min(self._tracked(accepted, seen, time_s), self._slower(accepted, seen, time_s))
        else:
            speed = self._commanded(seen, time_s)
        if self._random is None:
            return driving.within_capabilities(seen, speed)
        if abs(self._aim_mps - seen.speed_mps) > UNTRACKED * self._noise_mps:
            self._aim_mps = seen.speed_mps  # somebody else has driven
        # An error is one around the speed aimed at: it does not add up from step to step, as a weaker brake would.
        self._aim_mps = driving.within_capabilities(seen, speed, self._aim_mps)
        if self._aim_mps <= 0.0:
            return 0.0
        return min(seen.max_speed_mps, max(0.0, self._aim_mps + self._random.normal(0.0, self._noise_mps)))

    def _is_past(self, seen: Observation) -> bool:
        """Whether the rear stands clear of every conflict area: there the clearance ends, for the manager too."""
        beyond_m = -seen.distance_m
        return beyond_m - seen.length_m >= self._movement.clear_m and beyond_m >= self._movement.length_m

    def _consider_offer(self, seen: Observation, time_s: float) -> None:
        if self._offer is None:
            return
        term, offer = self._offer
        if time_s < offer.start_s - SAME_TIME_S and time_s <= offer.expires_s:
            return  # starts later: whether the vehicle is on it can only be seen then
        self._offer = None
        if (term, offer.id) in self._seen_offers:
            return  # a repetition of one that was already decided
        if self._accepted is not None and not self._accepted.profile.ended(time_s):
            return
        self._seen_offers.add((term, offer.id))
        start_m = self._distance_at(offer.start_s)
        if time_s > offer.expires_s or start_m is None:
            return
        profile = SpeedProfile(offer)
        drift_m = seen.distance_m - (start_m - profile.covered_m(time_s))
        if abs(seen.speed_mps - profile.speed_mps(time_s)) > OFFER_SPEED_MPS:
            return
        if driving.widest_drift(seen, profile, drift_m, time_s) > OFFER_DISTANCE_M:
            return
        self._accepted = _Accepted(offer.id, term, profile, start_m)

    def _consider_withdrawal(self, seen: Observation) -> None:
        """Give an accepted clearance back if it is asked for, and the vehicle can still stop before the line."""
        accepted, command = self._accepted, self._command
        if accepted is None or command is None or (command.term, command.withdrawn) != (accepted.term, accepted.id):
            return
        if driving.can_stop(seen, self._setback_m):
            self._accepted = None

    def _distance_at(self, time_s: float) -> float | None:
        """Its own distance to the line at `time_s`, from what it remembers; None if that is out of reach."""
        later: _Moment | None = None
        for moment in reversed(self._history):
            if abs(moment.time_s - time_s) < 1e-3:
                return moment.distance_m
            if moment.time_s < time_s:
                if later is None:
                    return None
                part = (time_s - moment.time_s) / (later.time_s - moment.time_s)
                return moment.distance_m + part * (later.distance_m - moment.distance_m)
            later = moment
        return None

    def _tracked(self, accepted: _Accepted, seen: Observation, time_s: float) -> float:
        """The speed that keeps it on the profile, or brings it back."""
        drift_m = seen.distance_m - (accepted.start_distance_m - accepted.profile.covered_m(time_s))
        return driving.tracking_speed(accepted.profile, drift_m, time_s)

    def _slower(self, accepted: _Accepted, seen: Observation, time_s: float) -> float:
        """What rear-end safety leaves of a profile: rule 2 with the vehicle's own radar, and this step's command.

        A command from before the manager knew of the acceptance would stop the vehicle at the line.
        """
        limit = driving.radar_limit(seen)
        command = self._command
        if command is None or command.time_s <= time_s - SAME_TIME_S:
            return limit
        same = (command.term, command.cleared) == (accepted.term, accepted.id)
        return min(limit, command.speed_mps) if same else limit

    def _commanded(self, seen: Observation, time_s: float) -> float:
        """The command's speed while there is one, else the fallback's."""
        command = self._command
        valid = command is not None and time_s <= command.valid_until_s
        if valid and command is not None and command.time_s > time_s - SAME_TIME_S:
            self.fallback = False
            may_cross = self._accepted is not None
            return min(command.speed_mps, driving.safe_limit(seen, setback_m=self._setback_m, may_cross=may_cross))
        limit = driving.own_limit(
            seen,
            self._movement,
            self._lane,
            setback_m=self._setback_m,
            may_cross=self._accepted is not None,
            turn_speed=self._turn_speed,
        )
        if valid and command is not None:
            self.fallback = False
            return min(command.speed_mps, limit)
        abandoned = command is not None or time_s > (self._newcomer_until_s or 0.0)
        if abandoned and not self.fallback:
            self.fallbacks += 1
        self.fallback = abandoned
        return min(driving.cruise(seen), limit)


def _stranger(seen: Observation) -> Stranger | None:
    """What the manager has to be told of the leader, if it cannot know it."""
    if not seen.leader_strange or seen.leader_gap_m is None or seen.leader_speed_mps is None:
        return None
    return Stranger(
        gap_m=seen.leader_gap_m,
        speed_mps=max(0.0, seen.leader_speed_mps),
        decel_mps2=seen.leader_decel_mps2 or seen.max_decel_mps2,
    )
