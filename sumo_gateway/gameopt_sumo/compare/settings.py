"""What all runs of a results folder have in common; a folder made with anything else is refused, never mixed."""

from __future__ import annotations

import fcntl
import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import msgspec

from gameopt_sumo.baselines.report import SCHEMA as REPORT_SCHEMA
from gameopt_sumo.compare.sources import OPTIONAL
from gameopt_sumo.files import write_whole

SCHEMA = "gameopt-compare/1"
FILE, LOCK = "settings.json", ".lock"
TUNING_SEEDS = (201, 202)
"""Lights are tuned on the arrivals of these seeds, which no comparison uses."""
DEVELOPED_ON = (*range(101, 111), 201, 202, 203)
"""The defaults of `coop` were chosen on runs of these seeds (docs/results/controller.md)."""
PLACES = ("sumo",)
"""Where something is found: not compared, for its digest says what it is."""

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
            if _agree(path, settings):
                write_whole(path, _text(settings))
        elif (out / "results.json").exists():
            raise SettingsError(f"{out}: has results.json but no {FILE}; choose another --out")
        else:
            write_whole(path, _text(settings))
    except OSError as error:
        raise SettingsError(f"{out}: cannot write: {error.strerror or error}") from None


def _text(settings: Settings) -> bytes:
    return msgspec.json.format(msgspec.json.encode(settings), indent=2) + b"\n"


def _agree(path: Path, settings: Settings) -> bool:
    """Refuse settings that are not those of the folder; whether a library has come that it lacked."""
    try:
        before = _flat(path.read_bytes())
    except msgspec.DecodeError as error:
        raise SettingsError(f"{path}: not the settings of a comparison: {error}") from None
    now = _flat(msgspec.json.encode(settings))
    optional = {f"versions.{name}" for name in OPTIONAL}
    for name in {**before, **now}:
        lacking = name in optional and None in (before.get(name), now.get(name))
        if before.get(name) != now.get(name) and not lacking:
            then, want = (msgspec.json.encode(known.get(name)).decode() for known in (before, now))
            raise SettingsError(
                f"{path.parent}: its results were made with {name} {then}, not {want}; choose another --out"
            )
    return any(name in now and name not in before for name in optional)


def _flat(settings: bytes) -> dict[str, Any]:
    """By name, and `versions.NAME`, so that a refusal can say which; without `PLACES`."""
    decoded = msgspec.json.decode(settings, type=dict[str, Any])
    versions = decoded.pop("versions", {})
    kept = {name: value for name, value in decoded.items() if name not in PLACES}
    return kept | {f"versions.{name}": version for name, version in versions.items()}


@contextmanager
def alone(out: Path) -> Iterator[None]:
    """Make the folder, and keep a second comparison out of it while this one runs. Raises `SettingsError`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        lock = (out / LOCK).open("w")
    except OSError as error:
        raise SettingsError(f"{error.filename}: cannot write: {error.strerror}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise SettingsError(f"{out}: another comparison is at work in it") from None
        yield
