"""One encoder and one decoder per message type, built once; a bad message is a `Rejected` with its reason."""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Generic, Literal, TypeVar

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
        self._floats, self._perhaps = map(_values_of, _numbers(kind))

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
        total = sum(self._floats(message))
        for value in self._perhaps(message):
            if value.__class__ is float:
                total += value
            elif value is not None:
                _check_finite(value)
        if not math.isfinite(total):  # with one that is not finite it is not; which one is looked for then
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


def _numbers(kind: type[Message]) -> tuple[list[str], list[str]]:
    """(fields that are a float, fields that may be one or a structure with some) of a message type."""
    inspect = msgspec.inspect
    fields = inspect.type_info(kind).fields  # type: ignore[attr-defined]
    unions = [(field.name, field.type.types) for field in fields if isinstance(field.type, inspect.UnionType)]
    numeric = (inspect.FloatType, inspect.StructType)
    return (
        [field.name for field in fields if isinstance(field.type, inspect.FloatType)],
        [name for name, types in unions if any(isinstance(each, numeric) for each in types)],
    )


def _values_of(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """A getter of several fields at once, whatever their number."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda message: tuple(getattr(message, name) for name in names)


def _check_finite(message: msgspec.Struct) -> None:
    """NaN passes every comparison with a bound, so it is looked for by name."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if isinstance(value, msgspec.Struct):
            _check_finite(value)
        elif isinstance(value, list):
            if not all(math.isfinite(each) for each in value if isinstance(each, float)):
                raise Rejected("out_of_range", f"a number of {name} is not finite")
        elif isinstance(value, float) and not math.isfinite(value):
            raise Rejected("out_of_range", f"{name} is {value}")


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
