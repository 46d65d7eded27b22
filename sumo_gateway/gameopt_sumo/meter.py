"""Everything that is measured on a running simulation, fed once per step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise, takewhile

from gameopt_sumo.collisions import OverlapCheck
from gameopt_sumo.encroachment import Encroachment
from gameopt_sumo.figures import Measurements
from gameopt_sumo.layout import Layout
from gameopt_sumo.measurements import Recorder
from gameopt_sumo.observation import Departure, Observation, Pose


class Meter:
    """Counts arrivals and crossings, books time and fuel, and checks bodies against each other."""

    def __init__(
        self,
        layout: Layout,
        outline: Sequence[tuple[float, float]],
        start_s: float,
        consumption_mg_s: Callable[[str], tuple[float, float]],
        inflate_m: float = 0.0,
    ) -> None:
        """`outline` is the junction's ground; `consumption_mg_s` gives a vehicle's fuel and CO2.

        `inflate_m` grows bodies all round in the geometric check.
        """
        self._start_s = start_s
        self._recorder = Recorder(layout.map, consumption_mg_s)
        self._overlaps = OverlapCheck(inflate_m)
        self._encroachment = Encroachment(outline)
        self._movement_lane = {movement.id: movement.lane for movement in layout.map.movements}
        self._came_from: dict[str, int] = {}
        self._known: set[str] = set()
        self._places = layout.places
        self._crossings = {
            (_edge(lane), choice.exit_edge) for lane, choices in layout.choices.items() for choice in choices
        }
        self._upstream: dict[str, tuple[float, float]] = {}
        """By edge of the approaches and the ways to them: where the control zone begins on it, and its limit."""
        for lane, place in layout.places.items():
            if place.kind == "approach" and place.lane is not None:
                self._upstream[_edge(lane)] = (place.observed_from_m, layout.map.lanes[place.lane].speed_limit_mps)
            elif place.limit_mps is not None and not lane.startswith(":"):
                begins_m = max(-layout.map.lanes[k].zone_m - offset_m for k, offset_m in place.offsets_m.items())
                self._upstream[_edge(lane)] = (max(0.0, begins_m), place.limit_mps)

    def arrivals(self, time_s: float, departed: Sequence[Departure], pending: Sequence[Departure]) -> None:
        """Vehicles that came into the simulation, and those whose time to come has been reached.

        One that departs on the approach is due at the control zone a free drive after its scheduled
        departure; one that comes from further off is due a free drive after reaching the approach (see
        `passing`).
        """
        for vehicle in pending:
            if vehicle.id not in self._known:
                self._known.add(vehicle.id)
                self._due(vehicle, time_s)
        for vehicle in departed:
            self._known.discard(vehicle.id)
            if self._due(vehicle, vehicle.scheduled_s):
                self._known.add(vehicle.id)

    def passing(self, vehicle: Departure, time_s: float) -> None:
        """A vehicle seen on an approach edge, or on the way to one, upstream of the control zone or where it begins."""
        if vehicle.id not in self._known:
            self._known.add(vehicle.id)
            self._due(vehicle, time_s)

    def knows(self, vehicle: str) -> bool:
        """Whether the vehicle's due time has been settled."""
        return vehicle in self._known

    def step(self, time_s: float, observations: Sequence[Observation], poses: Sequence[Pose]) -> None:
        """One step's vehicles."""
        for seen in observations:
            self._came_from[seen.vehicle] = self._movement_lane[seen.movement]
        self._recorder.step(time_s, observations)
        self._overlaps.step(poses)
        self._encroachment.step(time_s, poses, self._came_from)

    def faults(self, collisions: Sequence[tuple[str, str]], teleports: int) -> None:
        """What the simulator itself reports of the step."""
        self._recorder.collided(collisions)
        self._recorder.teleported(teleports)

    @property
    def overlapping(self) -> list[tuple[str, str]]:
        """The pairs of vehicles whose bodies have overlapped so far."""
        return list(self._overlaps.pairs)

    def measurements(self, time_s: float, warmup_s: float) -> Measurements:
        """The figures so far, without the first `warmup_s` of the run."""
        return self._recorder.measurements(
            self._start_s + warmup_s, time_s, len(self._overlaps.pairs), self._encroachment.least_s
        )

    def _due(self, vehicle: Departure, from_s: float) -> bool:
        """Settle when the vehicle is due at the control zone; False if it is not on an approach to it."""
        here = len(list(takewhile(self._upstream.__contains__, vehicle.route)))
        if here == 0 or not self._crossings & set(pairwise(vehicle.route[: here + 1])):
            return False
        zone_from_m, limit_mps = self._upstream[vehicle.route[0]]
        way_m = max(0.0, zone_from_m - vehicle.position_m)
        self._recorder.due(vehicle.id, from_s + way_m / min(limit_mps, vehicle.max_speed_mps))
        return True


def _edge(lane: str) -> str:
    return lane.rsplit("_", 1)[0]
