"""Golden bytes: what goes over the wire does not change by accident, and odd bytes are refused with their reason."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gameopt_wire import codec, keys
from gameopt_wire.messages import Bid, Clearance, Command, CycleReport, LedgerEntry, State, Step

STATE = State(
    vehicle="car.1", time_s=12.5, movement="0-1", distance_m=80.25, speed_mps=17.5, acceleration_mps2=-0.5,
    length_m=5.0, width_m=1.75, vehicle_class="passenger", max_speed_mps=50.0, max_accel_mps2=2.5,
    max_decel_mps2=4.5, term=7, accepted=3,
)  # fmt: skip
BID = Bid(vehicle="car.1", time_s=12.5, assertiveness=2.5)
OFFER = Clearance(id=3, start_s=12.5, expires_s=13.0, speeds_mps=[17.5, 17.75])
COMMAND = Command(
    vehicle="car.1", term=7, cycle=125, time_s=12.5, speed_mps=17.75, valid_until_s=13.0, slot_s=17.25,
    clearance=OFFER, rank=2, price=0.25,
)  # fmt: skip
STEP = Step(cycle=125, time_s=12.5, messages=2)
LEDGER = LedgerEntry(vehicle="car.1", term=7, entered_s=10.0, cleared_s=12.5, price=0.25, bid=0.5)
REPORT = CycleReport(
    term=7, cycle=125, time_s=12.5, vehicles=1, uncleared=1, cleared=0, commands=1, candidates=2, selected=-1,
    order=["car.1"], granted=["car.1"], delay_s=0.5, elapsed_ms=1.5, stages_ms={"auction": 0.5}, qp_solved_total=2,
    qp_failed_total=0, qp_late_total=0, missed_total=0, received_total=2, rejected_total={"malformed": 1},
    fallback=0, silent=0,
)  # fmt: skip

GOLDEN: list[tuple[str, codec.Codec[Any], Any, str]] = [
    (
        "state",
        codec.STATE,
        STATE,
        (
            "de0013a474797065a57374617465a776657273696f6e01a776656869636c65a56361722e31a674696d655f73cb"
            "4029000000000000a86d6f76656d656e74a3302d31aa64697374616e63655f6dcb4054100000000000a9737065"
            "65645f6d7073cb4031800000000000b1616363656c65726174696f6e5f6d707332cbbfe0000000000000a86c65"
            "6e6774685f6dcb4014000000000000a777696474685f6dcb3ffc000000000000ad76656869636c655f636c6173"
            "73a970617373656e676572ad6d61785f73706565645f6d7073cb4049000000000000ae6d61785f616363656c5f"
            "6d707332cb4004000000000000ae6d61785f646563656c5f6d707332cb4012000000000000a47465726d07a861"
            "6363657074656403a866616c6c6261636bc2a8737472616e676572c0ac6c65616465725f6761705f6dc0"
        ),
    ),
    (
        "bid",
        codec.BID,
        BID,
        (
            "85a474797065a3626964a776657273696f6e01a776656869636c65a56361722e31a674696d655f73cb40290000"
            "00000000ad6173736572746976656e657373cb4004000000000000"
        ),
    ),
    (
        "command",
        codec.COMMAND,
        COMMAND,
        (
            "8ea474797065a7636f6d6d616e64a776657273696f6e01a776656869636c65a56361722e31a47465726d07a563"
            "79636c657da674696d655f73cb4029000000000000a973706565645f6d7073cb4031c00000000000ad76616c69"
            "645f756e74696c5f73cb402a000000000000a6736c6f745f73cb4031400000000000a9636c656172616e636584"
            "a2696403a773746172745f73cb4029000000000000a9657870697265735f73cb402a000000000000aa73706565"
            "64735f6d707392cb4031800000000000cb4031c00000000000a7636c6561726564c0a977697468647261776ec0"
            "a472616e6b02a57072696365cb3fd0000000000000"
        ),
    ),
    (
        "step",
        codec.STEP,
        STEP,
        ("85a474797065a473746570a776657273696f6e01a56379636c657da674696d655f73cb4029000000000000a86d6573736167657302"),
    ),
    (
        "ledger",
        codec.LEDGER,
        LEDGER,
        (
            "89a474797065a66c6564676572a776657273696f6e01a776656869636c65a56361722e31a47465726d07a9656e"
            "74657265645f73cb4024000000000000a9636c65617265645f73cb4029000000000000a57072696365cb3fd000"
            "0000000000a3626964cb3fe0000000000000a66c6566745f73c0"
        ),
    ),
    (
        "cycle",
        codec.CYCLE,
        REPORT,
        (
            "de001ea474797065a56379636c65a776657273696f6e01a47465726d07a56379636c657da674696d655f73cb40"
            "29000000000000a876656869636c657301a9756e636c656172656401a7636c656172656400a8636f6d6d616e64"
            "7301aa63616e6469646174657302a873656c6563746564ffa56f7264657291a56361722e31a76772616e746564"
            "91a56361722e31a77265667573656400a977697468647261776e00a764656c61795f73cb3fe0000000000000aa"
            "656c61707365645f6d73cb3ff8000000000000a97374616765735f6d7381a761756374696f6ecb3fe000000000"
            "0000a877686f6c655f6d73c0a76c6174655f6d73c0af71705f736f6c7665645f746f74616c02af71705f666169"
            "6c65645f746f74616c00ad71705f6c6174655f746f74616c00ac6d69737365645f746f74616c00ae7265636569"
            "7665645f746f74616c02ae72656a65637465645f746f74616c81a96d616c666f726d656401a866616c6c626163"
            "6b00a673696c656e7400ad64726f707065645f746f74616c00ae756e736f6c7665645f746f74616c00"
        ),
    ),
]


@pytest.mark.parametrize(("codec_", "message", "golden"), [row[1:] for row in GOLDEN], ids=[row[0] for row in GOLDEN])
def test_every_message_has_its_bytes(codec_: codec.Codec[Any], message: Any, golden: str) -> None:
    assert codec_.encode(message).hex() == golden
    assert codec_.decode(bytes.fromhex(golden)) == message


def test_a_report_of_before_the_budget_is_read() -> None:
    fields = msgspec.msgpack.decode(codec.CYCLE.encode(REPORT))
    del fields["dropped_total"], fields["unsolved_total"]
    assert codec.CYCLE.decode(msgspec.msgpack.encode(fields)) == REPORT


def spoiled(**changes: object) -> bytes:
    """A state as bytes with some of its fields changed, or added."""
    return msgspec.msgpack.encode(msgspec.msgpack.decode(codec.STATE.encode(STATE)) | changes)


def test_fields_of_a_later_version_are_ignored() -> None:
    assert codec.STATE.decode(spoiled(colour="red")) == STATE


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "malformed"),
        (b"\xc1", "malformed"),
        (codec.STATE.encode(STATE)[:-1], "malformed"),
        (b"\x00" * (codec.MAX_BYTES + 1), "oversized"),
        (spoiled(version=2), "version"),
        (spoiled(version=2, speed_mps="fast"), "version"),
        (spoiled(speed_mps="fast"), "out_of_range"),
        (spoiled(speed_mps=float("nan")), "out_of_range"),
        (spoiled(acceleration_mps2=float("nan")), "out_of_range"),
        (spoiled(distance_m=float("inf")), "out_of_range"),
        (spoiled(length_m=-1.0), "out_of_range"),
        (spoiled(vehicle=""), "out_of_range"),
        (codec.BID.encode(BID), "out_of_range"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_reason(payload: bytes, reason: str) -> None:
    with pytest.raises(codec.Rejected) as refused:
        codec.STATE.decode(payload)
    assert refused.value.reason == reason


def test_a_clearance_of_no_number_is_refused() -> None:
    content = msgspec.msgpack.decode(codec.COMMAND.encode(COMMAND))
    content["clearance"]["speeds_mps"] = [1.0, float("nan")]
    with pytest.raises(codec.Rejected, match="out_of_range"):
        codec.COMMAND.decode(msgspec.msgpack.encode(content))


@given(st.text(min_size=1, max_size=64))
def test_any_name_makes_one_key_chunk_and_comes_back(name: str) -> None:
    key = keys.of_vehicle("a/b", "state", name)
    assert key.count("/") == 3
    assert not set("*$#?") & set(key)
    assert keys.vehicle_of(key) == name
    assert keys.is_of(key, name)
    assert not keys.is_of(key + "x", name)


@pytest.mark.parametrize(("chunk", "name"), [("%41", "%41"), ("a/b", "a/b"), ("b", "a/b"), ("A", "%41")])
def test_a_key_is_of_the_name_it_decodes_to(chunk: str, name: str) -> None:
    assert not keys.is_of(f"gameopt/main/state/{chunk}", name)
