"""Control cycles on disk: what came in, byte for byte, and the commands that went out, as MCAP.

One file is one run. A metadata record `gameopt` carries the charter, the parameters and the command line.
Topic `input` has one message a control cycle with everything that was drained for it, topic `command` one
with what was sent. Both are msgpack, logged at the control cycle's time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from gameopt_im.clock import Tick
from gameopt_im.core.parameters import Parameters
from gameopt_im.inbox import Raw
from gameopt_im.options import StartError
from gameopt_wire.intersection import Charter
from gameopt_wire.messages import Command

METADATA = "gameopt"
INPUT, COMMAND = "input", "command"
CHUNK_BYTES = 256 * 1024
"""Compressed and written at once: small, so that no control cycle waits long for it."""
MAX_RECORD_BYTES = 2**30
"""A file that announces a larger record is broken; it is not given the memory to prove it."""
_MAX_LOG_TIME_NS = 2**63 - 1


class RecordError(StartError):
    """A recording cannot be written or read."""


class _Input(msgspec.Struct, frozen=True):
    cycle: int
    time_s: float
    restarted: bool
    messages: list[Raw]
    ahead: int = 0


class _Output(msgspec.Struct, frozen=True):
    cycle: int
    commands: list[Command]


@dataclass(frozen=True, slots=True)
class RecordedCycle:
    """A control cycle as it was: its tick, and the commands that went out."""

    tick: Tick
    commands: list[Command]


@dataclass(frozen=True, slots=True)
class Recording:
    """What a file says of its run; `cycles` reads on in it.

    `options` is the command line of the run.
    """

    path: Path
    charter: Charter
    parameters: Parameters
    options: tuple[str, ...]

    def cycles(self) -> Iterator[RecordedCycle]:
        """The complete control cycles, in order.

        A file that was never closed, as after a crash, ends with its last complete one. Raises `RecordError`.
        """
        tick: Tick | None = None
        for topic, payload in _messages(self.path):
            if topic == INPUT:
                tick = _tick(_decoded(self.path, payload, _Input))
            elif topic == COMMAND and tick is not None:
                output = _decoded(self.path, payload, _Output)
                if output.cycle != tick.cycle:
                    raise RecordError(f"{self.path}: commands of control cycle {output.cycle} out of place")
                yield RecordedCycle(tick, output.commands)
                tick = None


class Recorder:
    """Writes control cycles to a file; `close` may come at any time, and twice."""

    def __init__(self, path: Path, charter: Charter, parameters: Parameters, options: Sequence[str]) -> None:
        self._encoder = msgspec.msgpack.Encoder()
        self._path = path
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise RecordError(f"{path}: {error.strerror or error}") from None
        self._writer: Writer | None = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="gameopt", library="gameopt")
        self._channels = {
            topic: self._writer.register_channel(topic, "msgpack", schema_id=0) for topic in (INPUT, COMMAND)
        }
        texts = {"charter": charter, "parameters": parameters, "options": list(options)}
        self._writer.add_metadata(
            METADATA, {name: msgspec.json.encode(value).decode() for name, value in texts.items()}
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def record(self, tick: Tick, commands: Sequence[Command]) -> None:
        """Writes a control cycle: what it was given, and what it sent. Raises `RecordError`."""
        self._add(INPUT, tick, _Input(tick.cycle, tick.time_s, tick.restarted, tick.messages, tick.ahead))
        self._add(COMMAND, tick, _Output(tick.cycle, list(commands)))

    def close(self) -> None:
        """Finishes the file; what was recorded is on disk then."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.finish()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise RecordError(f"{self._path}: {error.strerror or error}") from None
        finally:
            self._file.close()

    def _add(self, topic: str, tick: Tick, content: _Input | _Output) -> None:
        if self._writer is None:
            raise RecordError(f"{self._path}: already closed")
        at_ns = min(round(tick.time_s * 1e9), _MAX_LOG_TIME_NS)
        data = self._encoder.encode(content)
        try:
            self._writer.add_message(self._channels[topic], at_ns, data, at_ns, tick.cycle & 0xFFFF_FFFF)
        except OSError as error:
            raise RecordError(f"{self._path}: {error.strerror or error}") from None


def read(path: Path) -> Recording:
    """Opens a recording. Raises `RecordError` where it is none, or one of another version."""
    for record in _records(path):
        if isinstance(record, Metadata) and record.name == METADATA:
            texts = record.metadata
            try:
                return Recording(
                    path=path,
                    charter=msgspec.json.decode(texts["charter"], type=Charter),
                    parameters=msgspec.json.decode(texts["parameters"], type=Parameters),
                    options=msgspec.json.decode(texts["options"], type=tuple[str, ...]),
                )
            except (KeyError, msgspec.MsgspecError) as error:
                raise RecordError(f"{path}: recorded by another version of gameopt: {error}") from None
    raise RecordError(f"{path}: not a recording of gameopt-im")


def _messages(path: Path) -> Iterator[tuple[str, bytes]]:
    topics: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            yield topics.get(record.channel_id, ""), record.data


def _records(path: Path) -> Iterator[Any]:
    """All records in the order they were written, to the end of what is there."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None
    some = False
    with file:
        records = StreamReader(file, record_size_limit=MAX_RECORD_BYTES).records
        while True:
            try:
                record = next(records, None)
            except Exception as error:  # noqa: BLE001 - the reader and its decompressors trip in many ways
                if some and not file.read(1):
                    return  # cut short within its last record
                what = " ".join(str(error).split())
                raise RecordError(f"{path}: not a readable MCAP file: {what}") from None
            if record is None:
                return
            some = True
            yield record


def _decoded(path: Path, payload: bytes, kind: type[Any]) -> Any:
    try:
        return msgspec.msgpack.decode(payload, type=kind)
    except msgspec.MsgspecError as error:
        raise RecordError(f"{path}: recorded by another version of gameopt: {error}") from None


def _tick(content: _Input) -> Tick:
    return Tick(content.cycle, content.time_s, content.messages, content.restarted, ahead=content.ahead)
