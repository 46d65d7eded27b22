"""One encoder and one decoder per message type, built once; a bad message is a `Rejected` with its reason."""

from __future__ import annotations

import math
from typing import Generic, Literal, TypeVar

import msgspec

from gameopt_wire.intersection import Charter
from gameopt_wire.messages import (
    WIRE_VERSION,
    Bid,
    Command,
    CycleReport,
    LedgerEntry,
    Message,
    State,
    Step,
)

MAX_BYTES = 65_536
"""A vehicle's message larger than this is dropped unread."""
MAX_CHARTER_BYTES = 64 * 2**20
"""The map of a large junction is larger than any vehicle's message."""

Reason = Literal["oversized", "malformed", "version", "out_of_range"]
T = TypeVar("T", bound=Message)


class Rejected(Exception):  # noqa: N818 - the outcome of reading, not a fault of ours
    """A message that is not taken; `reason` is the label it is counted under."""

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason: Reason = reason


class Codec(Generic[T]):
    """Encode and decode one message type, by msgpack."""

    def __init__(self, kind: type[T], max_bytes: int = MAX_BYTES) -> None:
        self._decoder = msgspec.msgpack.Decoder(kind)
        self._encoder = msgspec.msgpack.Encoder()
        self._max_bytes = max_bytes

    def encode(self, message: T) -> bytes:
        """The message as bytes."""
        return self._encoder.encode(message)

    def decode(self, payload: bytes) -> T:
        """The message behind `payload`; raises `Rejected`, and nothing else, whatever the bytes are."""
        if len(payload) > self._max_bytes:
            raise Rejected("oversized", f"{len(payload)} bytes, allowed {self._max_bytes}")
        try:
            message = self._decoder.decode(payload)
        except msgspec.ValidationError as error:
            raise Rejected(_validation_reason(payload), str(error)) from None
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise Rejected("malformed", str(error)) from None
        if message.version != WIRE_VERSION:
            raise Rejected("version", f"wire version {message.version}, this is {WIRE_VERSION}")
        _check_finite(message)
        return message


class _VersionOnly(msgspec.Struct):
    version: int = WIRE_VERSION


_version_decoder = msgspec.msgpack.Decoder(_VersionOnly)


def _validation_reason(payload: bytes) -> Reason:
    """Why a well-formed payload does not fit: written by another version, or with a value not allowed."""
    try:
        return "out_of_range" if _version_decoder.decode(payload).version == WIRE_VERSION else "version"
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return "malformed"


def _check_finite(message: Message) -> None:
    """NaN passes every comparison with a bound, so it is looked for by name."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if isinstance(value, float) and not math.isfinite(value):
            raise Rejected("out_of_range", f"{name} is {value}")
        if name == "clearance" and value is not None and not all(map(math.isfinite, value.speeds_mps)):
            raise Rejected("out_of_range", "a speed of the clearance is not a finite number")


def step_mark(cycle: int) -> bytes:
    """Lock-step only: the Zenoh attachment of every state and bid that the `Step` of `cycle` counts."""
    return cycle.to_bytes(8, "big")


def marked_step(mark: bytes) -> int:
    """The control cycle of a mark; -1, which is none, for what is no mark, as strays have."""
    return int.from_bytes(mark, "big") if len(mark) == 8 else -1


STATE = Codec(State)
BID = Codec(Bid)
COMMAND = Codec(Command)
STEP = Codec(Step)
CYCLE = Codec(CycleReport)
LEDGER = Codec(LedgerEntry)
CHARTER = Codec(Charter, MAX_CHARTER_BYTES)
