"""Messages as they came off the network, before anyone has looked inside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

from gameopt_wire import keys

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


def within(messages: Sequence[Raw], most: int, known: Iterable[str], read: int = 0) -> tuple[Sequence[Raw], int]:
    """At most so many of the messages, in their order, and how many of the vehicles' are left out.

    Those under the keys of `known` vehicles come first, and of either the newest: who is there already is not crowded
    out by whoever floods other keys. What has been `read` before is on the account of the others.
    """
    if read + len(messages) <= most:
        return messages, 0
    chunks = {keys.encode(vehicle) for vehicle in known}
    of_known, others = list[int](), list[int]()
    for k, raw in enumerate(messages):
        (of_known if raw.key.rpartition("/")[2] in chunks else others).append(k)
    taken = of_known[-most:]
    taken += others[max(0, len(others) - max(0, most - read - len(taken))) :]
    kept = [messages[k] for k in sorted(taken)]
    return kept, sum(raw.kind != "gone" for raw in messages) - sum(raw.kind != "gone" for raw in kept)
