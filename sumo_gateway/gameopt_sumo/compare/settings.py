"""What all runs of a results folder have in common; a folder made with anything else is refused, never mixed."""

from __future__ import annotations

import fcntl
import hashlib
import platform
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import msgspec

from gameopt_sumo.baselines.report import SCHEMA as REPORT_SCHEMA
from gameopt_sumo.files import write_whole
from gameopt_wire import WIRE_VERSION

SCHEMA = "gameopt-compare/1"
FILE, LOCK = "settings.json", ".lock"
LIBRARIES = ("gameopt", "eclipse-zenoh", "osqp", "libsumo", "numpy", "numba")
TUNING_SEEDS = (201, 202)
"""Lights are tuned on the arrivals of these seeds, which no comparison uses."""

Geometry = Literal["areas", "box"]


class SettingsError(Exception):
    """Settings that are not allowed, or not those of the folder; one line."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """Durations in s. `sumo` is a scenario of the user's own, with the digest of all its files."""

    schema: str = SCHEMA
    report_schema: str = REPORT_SCHEMA
    versions: dict[str, str]
    duration_s: float
    warmup_s: float
    geometry: Geometry = "areas"
    turn_speed: bool = True
    tuning_budget: int
    """Signal plans tried, for each demand, before the lights are frozen."""
    tuning_seeds: tuple[int, ...] = TUNING_SEEDS
    sumo: str | None = None
    sumo_digest: str | None = None
    junction: str | None = None

    def __post_init__(self) -> None:
        """Raises `SettingsError`."""
        if not 0.0 <= self.warmup_s < self.duration_s:
            raise SettingsError(f"--warmup {self.warmup_s:g} s must be less than --duration {self.duration_s:g} s")


def versions() -> dict[str, str]:
    """Of everything that shapes a result."""
    return {
        "wire": str(WIRE_VERSION),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
    }


def digest(sumocfg: Path) -> str:
    """One digest of a scenario: its configuration and every file that it names. Raises `SettingsError`."""
    total = hashlib.sha256()
    try:
        configuration = sumocfg.read_bytes()
        values = [element.get("value") or element.get("v") or "" for element in ET.fromstring(configuration).iter()]
        named = [sumocfg.parent / name.strip() for value in values for name in value.split(",") if name.strip()]
        for content in (configuration, *(file.read_bytes() for file in named if file.is_file())):
            total.update(hashlib.sha256(content).digest())
    except (OSError, ET.ParseError) as error:
        raise SettingsError(f"{sumocfg}: cannot read: {error}") from None
    return total.hexdigest()


def claim(out: Path, settings: Settings) -> None:
    """Make `out` the folder of these settings, or see that it is. Raises `SettingsError`."""
    path = out / FILE
    try:
        out.mkdir(parents=True, exist_ok=True)
        if path.exists():
            _agree(path, settings)
        elif (out / "results.json").exists():
            raise SettingsError(f"{out}: has results.json but no {FILE}; choose another --out")
        else:
            write_whole(path, msgspec.json.format(msgspec.json.encode(settings), indent=2) + b"\n")
    except OSError as error:
        raise SettingsError(f"{out}: cannot write: {error.strerror or error}") from None


def _agree(path: Path, settings: Settings) -> None:
    try:
        before = _flat(path.read_bytes())
    except msgspec.DecodeError as error:
        raise SettingsError(f"{path}: not the settings of a comparison: {error}") from None
    now = _flat(msgspec.json.encode(settings))
    for name in {**before, **now}:
        if before.get(name) != now.get(name):
            then, want = (msgspec.json.encode(known.get(name)).decode() for known in (before, now))
            raise SettingsError(
                f"{path.parent}: its results were made with {name} {then}, not {want}; choose another --out"
            )


def _flat(settings: bytes) -> dict[str, Any]:
    """By name, and `versions.NAME`, so that a refusal can say which."""
    decoded = msgspec.json.decode(settings, type=dict[str, Any])
    versions = decoded.pop("versions", {})
    return decoded | {f"versions.{name}": version for name, version in versions.items()}


@contextmanager
def alone(out: Path) -> Iterator[None]:
    """Keep a second comparison out of the folder while this one runs. Raises `SettingsError`."""
    with (out / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise SettingsError(f"{out}: another comparison is at work in it") from None
        yield
