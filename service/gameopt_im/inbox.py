"""Messages as they came off the network, before anyone has looked inside."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

Kind = Literal["state", "bid", "step", "gone"]


class Raw(NamedTuple):
    """One message: its kind (`gone` is a liveliness token that vanished), payload and Zenoh key.

    `step` is the lock-step that counts it, -1 for a stray that none counts; None where nobody said.
    """

    kind: Kind
    payload: bytes
    key: str
    step: int | None = None


def split_steps(messages: Iterable[Raw]) -> tuple[list[Raw], list[Raw]]:
    """The messages of vehicles, and the simulator's steps, each in the order they came."""
    of_vehicles: list[Raw] = []
    steps: list[Raw] = []
    for raw in messages:
        (steps if raw.kind == "step" else of_vehicles).append(raw)
    return of_vehicles, steps
