"""An intersection map written as JSON, checked before anything relies on it."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gameopt_im.core.conflicts import ground
from gameopt_im.options import StartError
from gameopt_wire.intersection import IntersectionMap


class MapError(StartError):
    """The map cannot be used: file, where in it, and what is allowed."""


def read(path: Path) -> IntersectionMap:
    """The map in a JSON file. Raises `MapError`."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: {error.strerror or error}") from None
    return parse(text, str(path))


def parse(text: bytes, name: str) -> IntersectionMap:
    """The map in a JSON text; `name` stands at the head of errors. Raises `MapError`."""
    try:
        intersection = msgspec.json.decode(text, type=IntersectionMap)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise MapError(f"{name}: not an intersection map: {error}") from None
    ids = [movement.id for movement in intersection.movements]
    twice = sorted({each for each in ids if ids.count(each) > 1})
    if twice:
        raise MapError(f"{name}: movements: the id {twice[0]!r} is there twice")
    try:
        ground(intersection, "areas", 0.0, turn_speed=True)  # it looks at every index
    except ValueError as error:
        raise MapError(f"{name}: {error}") from None
    return intersection
