"""Where every vehicle is on the lanes of the junction and on the way to it, and which movement it is on."""

from __future__ import annotations

from itertools import pairwise

from gameopt_sumo import readings
from gameopt_sumo.layout import Layout, Place
from gameopt_sumo.observation import Vehicle
from gameopt_sumo.radar import Body


class Whereabouts:
    """The vehicles about, as SUMO has them after a step."""

    def __init__(self, layout: Layout) -> None:
        self.vehicles: dict[str, Vehicle] = {}
        """What is known of each, by id."""
        self.present: list[tuple[str, str]] = []
        """Every vehicle on the layout's lanes, with its lane, those upstream of the control zone too."""
        self.nearing: list[tuple[str, float, float]] = []
        """Those upstream of it: how far it is to the zone, m, and the speed limit there, m/s."""
        self._layout = layout
        self._lanes = layout.map.lanes
        self._movements = layout.map.movements
        self._of_edge: dict[str, list[tuple[str, Place]]] = {}
        for lane, place in layout.places.items():
            if place.kind in ("approach", "upstream") and not lane.startswith(":"):
                self._of_edge.setdefault(edge_of(lane), []).append((lane, place))

    def look(self) -> list[Body]:
        """All vehicles on the layout's lanes, but for those upstream of the control zone."""
        self.present, self.nearing = [], []
        bodies = []
        for lane, place in self._layout.places.items():
            for vehicle in readings.vehicles_on(lane):
                self.present.append((vehicle, lane))
                body = self._body(vehicle, lane, place, readings.position_m(vehicle))
                if body is not None:
                    bodies.append(body)
        return bodies

    def _body(self, vehicle: str, lane: str, place: Place, position_m: float) -> Body | None:
        if place.kind == "approach" and position_m < place.observed_from_m:
            if place.lane is not None:
                limit_mps = self._lanes[place.lane].speed_limit_mps
                self.nearing.append((vehicle, place.observed_from_m - position_m, limit_mps))
            return None
        if place.kind == "upstream":
            return self._upstream_body(vehicle, lane, place, position_m)
        known = self._known(vehicle, lane)
        if place.kind == "exit":
            return self._exit_body(known, lane, position_m)
        past_line_m = place.offset_m + position_m
        shared = self._shared(place.lane, past_line_m, known.length_m)
        wants = self._wants(known, lane, position_m) if known.movement is None and not known.halts else ()
        return Body(
            vehicle,
            known.movement,
            place.lane,
            past_line_m,
            known.length_m,
            shared=shared,
            wants=wants,
            halts=known.halts,
        )

    def _upstream_body(self, vehicle: str, lane: str, place: Place, position_m: float) -> Body | None:
        """A vehicle on the way to the approach; without a movement where it cannot go on from its lane."""
        any_lane = next(iter(place.offsets_m))
        to_zone_m = -self._lanes[any_lane].zone_m - place.offsets_m[any_lane] - position_m
        if to_zone_m > 0.0:
            limits_mps = [self._lanes[index].speed_limit_mps for index in place.offsets_m]
            self.nearing.append((vehicle, to_zone_m, min(limits_mps)))
            return None
        known = self._known(vehicle, lane)
        bound_for = None if known.movement is None else self._movements[known.movement].lane
        if bound_for not in place.offsets_m:
            bound_for = known.movement = None
        along = any_lane if bound_for is None else bound_for
        past_line_m = place.offsets_m[along] + position_m
        shared = self._shared(along, past_line_m, known.length_m)
        wants = self._wants(known, lane, position_m) if known.movement is None and not known.halts else ()
        return Body(
            vehicle,
            known.movement,
            bound_for,
            past_line_m,
            known.length_m,
            shared=shared,
            wants=wants,
            halts=known.halts,
        )

    def _exit_body(self, known: Vehicle, lane: str, position_m: float) -> Body:
        movement = None if known.movement is None else self._movements[known.movement]
        past_line_m = position_m if movement is None else movement.length_m + position_m
        from_lane = None if movement is None else movement.lane
        return Body(known.id, known.movement, from_lane, past_line_m, known.length_m, lane, position_m)

    def _shared(self, lane: int | None, past_line_m: float, length_m: float) -> tuple[tuple[str, float, float], ...]:
        """The upstream lanes that the body stands on, on its way to an approach lane; as `Body` has them."""
        if lane is None:
            return ()
        rear_m = past_line_m - length_m
        return tuple(
            (shared.lane, past_line_m - shared.begin_m, shared.end_m - shared.begin_m)
            for shared in self._layout.shared[lane]
            if rear_m < shared.end_m and past_line_m >= shared.begin_m
        )

    def _known(self, vehicle: str, lane: str) -> Vehicle:
        """The record of a vehicle, with its movement as its lane and route have it now."""
        known = self.vehicles.get(vehicle)
        if known is None:
            known = self.vehicles[vehicle] = readings.read_vehicle(vehicle)
        place = self._layout.places[lane]
        if known.controlled and place.kind in ("approach", "upstream"):
            self._keep_movement(known)
        if known.lane != lane or (known.movement is None and place.kind != "exit"):
            known.lane, known.halts = lane, self._halts(vehicle, place)
            stop = readings.next_stop(vehicle)
            known.stop_m = stop.end_m if stop is not None and stop.lane == lane and place.kind == "exit" else None
            if known.halts:
                known.movement = None  # SUMO's driver makes the stop, and is in charge until it goes on
            elif place.kind == "approach":
                known.movement = self._movement_ahead(vehicle, lane)
            elif place.kind == "upstream":
                known.movement = self._movement_beyond(vehicle)
            elif place.kind == "internal":
                known.movement = place.movement
        return known

    def _keep_movement(self, known: Vehicle) -> None:
        """Who is given another route while it is taken over keeps its old one, if the new one needs another movement.

        It has spoken of that movement, and may hold a clearance for it.
        """
        route_id = readings.route_id(known.id)
        if route_id == known.route_id:
            return
        ahead = readings.route_ahead(known.id)
        if self._movement_beyond(known.id) != known.movement:
            before = known.route[known.route.index(ahead[0]) :]
            if readings.set_route(known.id, before):
                ahead = before
            else:
                known.movement = None  # its road is closed: it goes where the new one leads from its lane
        known.route_id, known.route = readings.route_id(known.id), ahead

    def _halts(self, vehicle: str, place: Place) -> bool:
        """Whether a vehicle has planned a stop on its way to the line: on its route up to the approach it takes."""
        stop = readings.next_stop(vehicle) if place.kind in ("approach", "upstream") else None
        if stop is None:
            return False
        for edge in readings.route_ahead(vehicle):
            if edge == edge_of(stop.lane):
                return True
            if any(beside.kind == "approach" for _, beside in self._of_edge.get(edge, ())):
                return False
        return False

    def _movement_ahead(self, vehicle: str, lane: str) -> int | None:
        """The movement that this lane offers towards the vehicle's next edge; None on a wrong lane."""
        onward = readings.route_ahead(vehicle)[1:2]
        choices = [choice for choice in self._layout.choices.get(lane, ()) if (choice.exit_edge,) == onward]
        if len(choices) > 1:
            via = next(iter(readings.vias_ahead(vehicle)), None)
            choices = [choice for choice in choices if choice.via == via] or choices
        return choices[0].movement if choices else None

    def _movement_beyond(self, vehicle: str) -> int | None:
        """The movement that SUMO leads the vehicle to from an upstream lane; None where it has to change lanes."""
        vias = set(readings.vias_ahead(vehicle))
        choices = (choice for offered in self._layout.choices.values() for choice in offered)
        return next((choice.movement for choice in choices if choice.via in vias), None)

    def _wants(self, known: Vehicle, lane: str, position_m: float) -> tuple[tuple[int, float], ...]:
        """The approach lanes that a vehicle on a wrong lane could change to, and how far it is on each."""
        turns = set(pairwise(readings.route_ahead(known.id)))
        wants = []
        for beside, place in self._of_edge.get(edge_of(lane), ()):
            offsets = place.offsets_m or ({} if place.lane is None else {place.lane: place.offset_m})
            for index, offset_m in offsets.items() if beside != lane else ():
                approach = self._lanes[index].id
                if any((edge_of(approach), choice.exit_edge) in turns for choice in self._layout.choices[approach]):
                    wants.append((index, offset_m + position_m))
        return tuple(wants)


def edge_of(lane: str) -> str:
    """The edge a lane belongs to."""
    return lane.rsplit("_", 1)[0]
