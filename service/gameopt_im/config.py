"""TOML -> `Parameters`, validated once. Whatever is wrong is one line: file, key and what is allowed."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from gameopt_im.core.parameters import Parameters, VehicleClass
from gameopt_im.options import StartError
from gameopt_im.reference import allowed, reference
from gameopt_wire.messages import Profile

__all__ = ["ConfigError", "load", "parse", "reference"]

ROUNDING_S = 1e-9

_PATH = re.compile(r" - at `\$\.?([^`]*)`$")
_UNKNOWN = re.compile(r"Object contains unknown field `([^`]*)`")


class ConfigError(StartError):
    """The configuration cannot be used: `FILE: key: what is allowed`."""


class _WrongError(Exception):
    """A key and what is wrong with it, before the file's name is put in front."""

    def __init__(self, key: str, what: str) -> None:
        super().__init__(f"{key}: {what}" if key else what)


def load(path: Path | None) -> Parameters:
    """The parameters of a TOML file, or the defaults where there is none. Raises `ConfigError`."""
    if path is None:
        return Parameters()
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not UTF-8 text, which TOML is") from None
    return parse(text, str(path))


def parse(text: str, name: str = "configuration") -> Parameters:
    """The parameters in a TOML text; `name` stands at the head of errors. Raises `ConfigError`."""
    try:
        given = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"{name}: not TOML: {_one_line(error)}") from None
    try:
        _check_finite(given)
        parameters = _convert(given)
        _cross_check(parameters)
    except _WrongError as wrong:
        raise ConfigError(f"{name}: {wrong}") from None
    return parameters


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _check_finite(given: Mapping[str, Any]) -> None:
    """TOML knows nan and inf, and nan passes some bounds by failing every comparison."""
    for key, value in _leaves(given, ""):
        if isinstance(value, float) and not math.isfinite(value):
            raise _WrongError(key, f"{value} is not a finite number")


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{key}[{index}]")
    else:
        yield key, value


def _convert(given: dict[str, Any]) -> Parameters:
    """The file laid over the defaults, table by table: a class in the file changes only the keys it names."""
    merged = _merge(msgspec.to_builtins(Parameters()), given)
    classes = merged["classes"]
    if isinstance(classes, dict):
        passenger = classes.get("passenger")
        for name, table in classes.items():
            if isinstance(passenger, dict) and isinstance(table, dict):
                classes[name] = _merge(passenger, table)
        # msgspec's path does not say which entry of a mapping is wrong, so each class is looked at by itself.
        for name, table in classes.items():
            _typed(table, VehicleClass, f"classes.{name}", given)
    parameters: Parameters = _typed(merged, Parameters, "", given)
    return parameters


def _merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        merged[key] = _merge(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def _typed(table: Any, kind: type[Any], prefix: str, given: Mapping[str, Any]) -> Any:
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise _explain(str(error), prefix, given) from None


def _explain(message: str, prefix: str, given: Mapping[str, Any]) -> _WrongError:
    """msgspec's message with our key in front of it and the allowed range behind it."""
    at = _PATH.search(message)
    what = message[: at.start()] if at else message
    key = ".".join(part for part in (prefix, at.group(1) if at else "") if part)
    unknown = _UNKNOWN.fullmatch(what)
    if unknown:
        full = f"{key}.{unknown.group(1)}" if key else unknown.group(1)
        return _WrongError(full, f"unknown key; allowed here: {allowed(key)}")
    value = _given_at(given, key)
    return _WrongError(key, f"allowed: {allowed(key)}" + ("" if value is None else f"; given: {value!r}"))


def _given_at(given: Mapping[str, Any], key: str) -> Any:
    """The value the file gives a key, None where it does not come from the file."""
    return dict(_branches(given, "")).get(key)


def _branches(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    yield key, value
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _branches(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _branches(inner, f"{key}[{index}]")


SWITCHES = (
    "auction.order",
    "planner.incumbent",
    "planner.selection",
    "planner.upstream",
    "program.solve",
    "interlock.ask",
)
"""Keys that make another method of the default profile; the paper's is one method, and has none of these parts."""


def check_profile(parameters: Parameters, profile: Profile, name: str = "configuration") -> None:
    """Refuse keys that the profile does not follow: a run must be what its configuration says. Raises `ConfigError`."""
    if profile == "default":
        return
    usual = Parameters()
    for key in SWITCHES:
        table, field = key.split(".")
        given, default = (getattr(getattr(each, table), field) for each in (parameters, usual))
        if given != default:
            raise ConfigError(
                f"{name}: {key}: allowed under --profile paper: {_shown(default)}; given: {_shown(given)}"
            )


def _shown(value: Any) -> str:
    """As TOML writes it."""
    return str(value).lower() if isinstance(value, bool) else f'"{value}"'


def _check_methods(parameters: Parameters) -> None:
    """Switches that only make sense together."""
    planner, ask = parameters.planner, parameters.interlock.ask
    first_come = parameters.auction.order == "arrival"
    for wrong, key, allowed_value, cause in (
        (first_come and planner.incumbent, "planner.incumbent", "false", 'auction.order = "arrival"'),
        (not planner.upstream and parameters.program.solve, "program.solve", "false", "planner.upstream = false"),
        (
            planner.selection == "objective" and not parameters.program.solve,
            "planner.selection", '"delay"', "program.solve = false",
        ),
        (ask == "standing" and not first_come, "auction.order", '"arrival"', 'interlock.ask = "standing"'),
        (ask == "standing" and planner.upstream, "planner.upstream", "false", 'interlock.ask = "standing"'),
    ):  # fmt: skip
        if wrong:
            raise _WrongError(key, f"allowed with {cause}: {allowed_value}")


def _cross_check(parameters: Parameters) -> None:
    """What no single key can be held to."""
    _check_methods(parameters)
    planner, interlock, service = parameters.planner, parameters.interlock, parameters.service
    least_s = interlock.margin_s
    if planner.margin_s < least_s - ROUNDING_S:
        raise _WrongError(
            "planner.margin_s", f"allowed: >= interlock.margin_s = {least_s:g} s; given: {planner.margin_s!r}"
        )
    if service.stale_s > service.hold_s:
        raise _WrongError("service.stale_s", f"allowed: at most service.hold_s = {service.hold_s:g} s")
    decels = planner.decels_mps2
    if not decels or list(decels) != sorted(set(decels)):
        raise _WrongError("planner.decels_mps2", "allowed: one or more decelerations, softest first, none twice")
    for index, weights in enumerate(parameters.auction.weights):
        if min(weights) < 0.0 or sum(weights) <= 0.0:
            raise _WrongError(f"auction.weights[{index}]", "allowed: four numbers >= 0, not all of them 0")
    if "passenger" not in parameters.classes:
        raise _WrongError("classes.passenger", "must be there: a class not listed counts as passenger")
    for name, vehicle_class in parameters.classes.items():
        _check_class(f"classes.{name}", vehicle_class, parameters.auction.assertiveness_bound)


def _check_class(key: str, bounds: VehicleClass, most: float) -> None:
    low, high = bounds.assertiveness
    if not 0.0 <= low <= high <= most:
        raise _WrongError(
            f"{key}.assertiveness",
            f"allowed: [low, high] with 0 <= low <= high <= auction.assertiveness_bound = {most:g}; "
            f"given: {[low, high]}",
        )
    for name, pair in (
        ("speed_priority", bounds.speed_priority),
        ("variation_priority", bounds.variation_priority),
    ):
        if min(pair) <= 0.0:
            raise _WrongError(f"{key}.{name}", f"allowed: two numbers > 0; given: {list(pair)}")
