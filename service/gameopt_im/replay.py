"""Recorded control cycles run again through the real service, and the first command that differs."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, NamedTuple, Protocol

import msgspec

from gameopt_im.inbox import Raw
from gameopt_im.manager import Manager
from gameopt_im.options import ServeOptions
from gameopt_im.recorder import Recording
from gameopt_im.service import solver_of
from gameopt_wire.messages import Command

ABSENT = "absent"


class Decided(Protocol):
    """What a control cycle came to, as far as a replay looks at it."""

    @property
    def commands(self) -> Sequence[Command]:
        """The commands to send."""


class ControlCycle(Protocol):
    """The service: everything that is decided, from messages in to commands out."""

    def read_ahead(self, messages: Sequence[Raw], time_s: float) -> int:
        """Take in the first messages of the next control cycle; how many it took."""

    async def control_cycle(self, cycle: int, time_s: float, messages: list[Raw]) -> Decided:
        """One control cycle."""

    def restart(self) -> None:
        """Lock-step time begins anew."""


class Difference(NamedTuple):
    """The first thing that came out otherwise; `field` is `command` where one side has none."""

    cycle: int
    vehicle: str
    field: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        return (
            f"control cycle {self.cycle}, vehicle {self.vehicle}, {self.field}: "
            f"recorded {self.recorded!r}, replayed {self.replayed!r}"
        )


class Replayed(NamedTuple):
    """How far a replay came, and why it stopped; None for no difference."""

    cycles: int
    difference: Difference | None


def options_of(recording: Recording) -> ServeOptions:
    """The options of the recorded run, as far as they bear on what is decided; solved in this process."""
    charter = recording.charter
    return ServeOptions(
        map=charter.map,
        parameters=recording.parameters,
        profile=charter.profile,
        geometry=charter.geometry,
        turn_speed=charter.turn_speed,
        candidates=charter.candidates,
        workers=0,
        clock=charter.clock,
    )


@asynccontextmanager
async def manager_of(recording: Recording) -> AsyncIterator[Manager]:
    """The manager as it was at the start of the recorded run."""
    options = options_of(recording)
    async with solver_of(options) as pool:
        yield Manager(options, recording.charter.term, pool)


async def replay(
    recording: Recording,
    start: Callable[[Recording], AbstractAsyncContextManager[ControlCycle]] = manager_of,
) -> Replayed:
    """Runs the recording to its end or to the first difference."""
    count = 0
    async with start(recording) as service:
        for recorded in recording.cycles():
            tick = recorded.tick
            if tick.restarted:
                service.restart()
            service.read_ahead(tick.messages[: tick.ahead], tick.time_s)
            outcome = await service.control_cycle(tick.cycle, tick.time_s, tick.messages)
            count += 1
            difference = first_difference(tick.cycle, recorded.commands, outcome.commands)
            if difference is not None:
                return Replayed(count, difference)
    return Replayed(count, None)


def first_difference(cycle: int, recorded: Sequence[Command], replayed: Sequence[Command]) -> Difference | None:
    """The first command, in the recorded order, that is not bit for bit the same."""
    again = {command.vehicle: command for command in replayed}
    for command in recorded:
        other = again.pop(command.vehicle, None)
        if other is None:
            return Difference(cycle, command.vehicle, "command", "sent", ABSENT)
        if other != command:
            field, was, now = _first_field(command, other, "")
            return Difference(cycle, command.vehicle, field, was, now)
    for vehicle in again:
        return Difference(cycle, vehicle, "command", ABSENT, "sent")
    return None


def _first_field(was: msgspec.Struct, now: msgspec.Struct, prefix: str) -> tuple[str, Any, Any]:
    for name in was.__struct_fields__:
        a, b = getattr(was, name), getattr(now, name)
        if a == b:
            continue
        if isinstance(a, msgspec.Struct) and isinstance(b, msgspec.Struct):
            return _first_field(a, b, f"{prefix}{name}.")
        if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
            index = next(index for index, pair in enumerate(zip(a, b, strict=True)) if pair[0] != pair[1])
            return f"{prefix}{name}[{index}]", a[index], b[index]
        return prefix + name, a, b
    return prefix.rstrip("."), was, now
