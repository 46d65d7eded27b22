"""Whatever arrives, the decoder and the tracker count it and go on: nothing raises, nobody else is harmed."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gameopt_im.admission import ENDLESS, can_wait
from gameopt_im.core.conflicts import ground
from gameopt_im.core.parameters import Parameters, Service
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.inbox import Kind, Raw
from gameopt_im.tracker import Tracker
from gameopt_wire import codec, keys
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Clock, State

ROADS = msgspec.json.decode((Path(__file__).parents[1] / "maps" / "crossroads.json").read_bytes(), type=IntersectionMap)
GROUND = ground(ROADS, "areas", 25.0, turn_speed=True)
PARAMETERS = Parameters(service=Service(max_vehicles=5))
NOW_S = 100.0
WITNESS = State(
    vehicle="witness",
    time_s=NOW_S,
    movement="0-1",
    distance_m=80.0,
    speed_mps=10.0,
    acceleration_mps2=0.0,
    length_m=5.0,
    width_m=1.8,
    vehicle_class="truck",
    max_speed_mps=40.0,
    max_accel_mps2=2.0,
    max_decel_mps2=4.0,
)

clocks = st.sampled_from(["wall", "lockstep"])
kinds: st.SearchStrategy[Kind] = st.sampled_from(["state", "bid", "gone"])
names = st.one_of(st.sampled_from(["a", "b", "witness"]), st.text(max_size=70))
numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e-300, NOW_S, NOW_S + 0.5, 5_000.0, -5_000.0, 1e11]),
    st.floats(NOW_S - 3.0, NOW_S + 1.5),
)
anything = st.one_of(numbers, names, st.integers(-(2**63), 2**64 - 1), st.booleans(), st.none(), st.binary(max_size=8))

plausible = st.fixed_dictionaries(
    {
        "type": st.just("state"),
        "version": st.just(1),
        "vehicle": st.text(min_size=1, max_size=64),
        "time_s": st.floats(NOW_S - 2.5, NOW_S + 1.5),
        "movement": st.sampled_from(["0-1", "0-0", "2-1", "9-9"]),
        "distance_m": st.floats(-500.0, 220.0),
        "speed_mps": st.floats(0.0, 100.0),
        "acceleration_mps2": st.floats(-50.0, 50.0),
        "length_m": st.floats(0.1, 40.0),
        "width_m": st.floats(0.1, 5.0),
        "vehicle_class": st.sampled_from(["passenger", "truck", "emergency", "ufo"]),
        "max_speed_mps": st.floats(0.1, 100.0),
        "max_accel_mps2": st.floats(0.1, 30.0),
        "max_decel_mps2": st.floats(0.1, 30.0),
        "term": st.integers(0, 2**62),
        "accepted": st.one_of(st.none(), st.integers(0, 2**62)),
    }
)
bids = st.fixed_dictionaries({"type": st.just("bid"), "vehicle": names, "time_s": numbers, "assertiveness": numbers})


@st.composite
def spoiled(draw: st.DrawFn) -> dict[str, Any]:
    """A message with one field that may be anything, or not there at all."""
    message = dict(draw(st.one_of(plausible, bids)))
    name = draw(st.sampled_from(sorted(message)))
    if draw(st.booleans()):
        del message[name]
    else:
        message[name] = draw(anything)
    return message


@st.composite
def raws(draw: st.DrawFn) -> Raw:
    """A message on the key of its vehicle, or of anybody, or on no key of ours."""
    kind = draw(kinds)
    message = draw(st.one_of(plausible, bids, spoiled(), st.binary(max_size=200)))
    if isinstance(message, bytes):
        payload, vehicle = message, draw(names)
    else:
        payload = msgspec.msgpack.encode(message)
        vehicle = draw(st.one_of(st.just(str(message.get("vehicle", ""))), names))
        cut = draw(st.integers(0, 4 * len(payload)))
        payload = payload[:cut] if cut < len(payload) else payload
    if kind == "gone":
        return Raw(kind, b"", keys.alive(ROADS.intersection, vehicle))
    good_key = keys.of_vehicle(ROADS.intersection, kind, vehicle)
    return Raw(kind, payload, draw(st.one_of(st.just(good_key), st.just(good_key), st.text(max_size=20))))


def sound(snapshot: Snapshot) -> bool:
    """Numbers everywhere, and within what the map and the vehicles can be."""
    columns = (
        snapshot.s, snapshot.v, snapshot.length, snapshot.a_max, snapshot.b_max, snapshot.v_max,
        snapshot.waited, snapshot.assertiveness, snapshot.speed_priority, snapshot.variation_priority,
        snapshot.age,
    )  # fmt: skip
    return (
        all(column.shape == (len(snapshot),) and np.isfinite(column).all() for column in columns)
        and bool((snapshot.v >= 0.0).all())
        and bool((snapshot.v_max > 0.0).all())
        and bool((snapshot.waited >= 0.0).all())
        and bool(((snapshot.movement >= 0) & (snapshot.movement < len(ROADS.movements))).all())
        and bool(((snapshot.footprint >= 0) & (snapshot.footprint < len(ROADS.footprints))).all())
        and len(set(snapshot.ids)) == len(snapshot)
    )


@given(clock=clocks, messages=st.lists(raws(), max_size=12), later_s=st.floats(0.0, 40.0))
@settings(max_examples=300)
def test_garbage_is_counted_and_harms_nobody(clock: Clock, messages: list[Raw], later_s: float) -> None:
    tracker = Tracker(ROADS, GROUND, PARAMETERS, clock, term=1)
    witness = Raw("state", codec.STATE.encode(WITNESS), keys.of_vehicle("x", "state", "witness"))
    tracker.ingest([witness], NOW_S)
    tracker.snapshot(999, NOW_S)
    tracker.take_events()
    strangers = [raw for raw in messages if "witness" not in raw.key]
    tracker.ingest(strangers, NOW_S)
    snapshot = tracker.snapshot(1000, NOW_S)

    assert sound(snapshot)
    assert len(snapshot) <= ENDLESS * PARAMETERS.service.max_vehicles
    waiting = [name for name in snapshot.ids if can_wait(tracker.vehicle(name).last)]
    assert len(waiting) <= PARAMETERS.service.max_vehicles
    row = snapshot.ids.index("witness")
    assert (snapshot.s[row], snapshot.v[row], snapshot.silent[row]) == (80.0, 10.0, False)
    assert tracker.received == 1 + sum(raw.kind != "gone" for raw in strangers)
    assert sum(tracker.rejected.values()) <= tracker.received

    assert sound(tracker.snapshot(1001, NOW_S + later_s))
    assert len(tracker.snapshot(2000, NOW_S + PARAMETERS.service.hold_s + 2.0)) == 0


@given(messages=st.lists(raws(), max_size=12))
@settings(max_examples=150)
def test_every_rejection_has_its_reason(messages: list[Raw]) -> None:
    tracker = Tracker(ROADS, GROUND, PARAMETERS, "lockstep", term=1)
    for raw in messages:
        before = sum(tracker.rejected.values())
        tracker.ingest([raw], NOW_S)
        assert sum(tracker.rejected.values()) - before in (0, 1)
    allowed = {
        "oversized", "malformed", "version", "out_of_range", "key", "unknown_movement", "uncovered", "time",
        "duplicate", "stale", "changed", "overload", "flood",
    }  # fmt: skip
    assert set(tracker.rejected) <= allowed


@given(payload=st.binary(max_size=400))
@settings(max_examples=500)
def test_the_decoder_raises_nothing_but_a_rejection(payload: bytes) -> None:
    for decoder in (codec.STATE, codec.BID, codec.STEP, codec.COMMAND):
        with contextlib.suppress(codec.Rejected):
            decoder.decode(payload)


@given(message=spoiled())
@settings(max_examples=300)
def test_what_the_decoder_accepts_is_finite_and_within_bounds(message: dict[str, Any]) -> None:
    try:
        state = codec.STATE.decode(msgspec.msgpack.encode(message))
    except codec.Rejected:
        return
    assert -5_000.0 <= state.distance_m <= 5_000.0
    assert 0.0 <= state.speed_mps <= 100.0
    assert 0.1 <= state.max_decel_mps2 <= 30.0
    assert 1 <= len(state.vehicle) <= 64


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_number_may_be_missing_or_endless(value: float) -> None:
    whole = msgspec.to_builtins(WITNESS) | {
        "leader_gap_m": 5.0,
        "stranger": {"gap_m": 9.0, "speed_mps": 3.0, "decel_mps2": 4.0},
    }
    assert codec.STATE.decode(msgspec.msgpack.encode(whole)).stranger is not None
    numbers_of = [(whole, name) for name, number in whole.items() if isinstance(number, float)]
    numbers_of += [(whole["stranger"], name) for name in whole["stranger"]]
    assert len(numbers_of) == 13
    for part, name in numbers_of:
        good, part[name] = part[name], value
        with pytest.raises(codec.Rejected, match="out_of_range"):
            codec.STATE.decode(msgspec.msgpack.encode(whole))
        part[name] = good


@given(
    messages=st.lists(plausible.map(lambda message: msgspec.convert(message, State)), max_size=8),
    order=st.randoms(use_true_random=False),
)
@settings(max_examples=100)
def test_in_lock_step_the_order_of_arrival_does_not_matter(messages: list[State], order: Any) -> None:
    """Within one control cycle, one state a vehicle: what the network shuffles, the snapshot sorts."""
    unique = {message.vehicle: message for message in messages}
    raw = [
        Raw("state", codec.STATE.encode(message), keys.of_vehicle("x", "state", vehicle))
        for vehicle, message in unique.items()
    ]
    shuffled = list(raw)
    order.shuffle(shuffled)
    pictures = []
    for arrived in (raw, shuffled):
        tracker = Tracker(ROADS, GROUND, PARAMETERS, "lockstep", term=1)
        tracker.ingest(arrived, NOW_S)
        pictures.append(tracker.snapshot(1000, NOW_S))
    assert pictures[0].ids == pictures[1].ids
    assert pictures[0].s.tobytes() == pictures[1].s.tobytes()
