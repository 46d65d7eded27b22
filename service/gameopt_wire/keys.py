"""Zenoh key expressions: `gameopt/{intersection}/…`. Nobody writes a key by hand."""

from __future__ import annotations

from typing import Literal
from urllib.parse import quote, unquote

ROOT = "gameopt"
Stream = Literal["state", "bid", "command", "ledger"]


def encode(name: str) -> str:
    """A name as one key chunk: everything but letters, digits and `_.-~` is percent-encoded.

    Zenoh reserves `/ * $ # ?`; the percent sign itself is encoded too, so `decode` is the exact inverse.
    """
    return quote(name, safe="")


def decode(chunk: str) -> str:
    """The name behind a key chunk; the inverse of `encode`."""
    return unquote(chunk)


def of_vehicle(intersection: str, stream: Stream, vehicle: str) -> str:
    """The key of one vehicle's stream, e.g. `gameopt/main/state/car%2F1`."""
    return f"{ROOT}/{encode(intersection)}/{stream}/{encode(vehicle)}"


def of_all(intersection: str, stream: Stream) -> str:
    """The wildcard that matches every vehicle's stream."""
    return f"{ROOT}/{encode(intersection)}/{stream}/*"


def cycle(intersection: str) -> str:
    """The manager's report per control cycle."""
    return f"{ROOT}/{encode(intersection)}/cycle"


def step(intersection: str) -> str:
    """The simulator's announcement of a lock-step."""
    return f"{ROOT}/{encode(intersection)}/step"


def intersection_map(intersection: str) -> str:
    """The queryable that answers with a `Charter`."""
    return f"{ROOT}/{encode(intersection)}/map"


def alive(intersection: str, who: str) -> str:
    """A liveliness token: `manager`, or a vehicle's id."""
    return f"{ROOT}/{encode(intersection)}/alive/{encode(who)}"


def vehicle_of(key: str) -> str:
    """The vehicle id at the end of a per-vehicle key."""
    return decode(key.rsplit("/", 1)[-1])


def is_of(key: str, vehicle: str) -> bool:
    """Whether a per-vehicle key is this vehicle's; most names need no encoding."""
    return (key.rpartition("/")[2] == vehicle and "%" not in vehicle) or vehicle_of(key) == vehicle
