"""What `gameopt-im serve` was asked to do, checked and complete before anything starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gameopt_im.core.parameters import Parameters
from gameopt_im.web.address import Address
from gameopt_wire.intersection import IntersectionMap
from gameopt_wire.messages import Clock, Geometry, Profile

LogFormat = Literal["text", "json"]

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where the manager listens when nothing else is said."""


class StartError(Exception):
    """Something given at the start cannot be used; the message is the one line its user reads."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeOptions:
    """The options of `gameopt-im serve`.

    `listen` and `connect` are Zenoh endpoints (`tcp/127.0.0.1:7447`); where given, they replace those of the
    user's own `zenoh_config`.
    `candidates` is K, at most the number of configured weight vectors. `http` is where the web server
    listens, None for nowhere.
    `command_line` is what was typed, for a recording's own account of itself.
    """

    map: IntersectionMap
    parameters: Parameters
    profile: Profile = "default"
    geometry: Geometry = "areas"
    turn_speed: bool = True
    candidates: int = 8
    workers: int = 1
    clock: Clock = "wall"
    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[str, ...] = ()
    zenoh_config: Path | None = None
    http: Address | None = None
    record: Path | None = None
    log_format: LogFormat = "text"
    command_line: tuple[str, ...] = ()
