"""The methods that can be compared, by name: how the manager is set up, or which control SUMO runs by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from gameopt_sumo.compare.settings import Geometry

CONFIGURATIONS = Path(__file__).with_name("methods")
"""Configurations of the manager, one for each method that is the manager set up in its own way."""

Plan = Literal["same", "even"]
"""Lights tuned at the very flow and ratio they are measured at, or at the same flow with a ratio of 1."""


class MethodError(Exception):
    """A method that is not there, or that does not go with the rest; one line."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """One way of running the junction."""

    name: str
    about: str
    control: str | None = None
    """What SUMO runs by itself, a baseline's name; None is our manager and our vehicles."""
    configuration: Path | None = None
    profile: str | None = None
    geometry: Geometry | None = None
    """Where the method fixes it; else the comparison's."""
    plan: Plan | None = None

    @property
    def ours(self) -> bool:
        """Whether manager and vehicles run it."""
        return self.control is None


_FIXED = (
    Method(name="coop", about="the manager with the profile `default`"),
    Method(name="coop-paper", about="the profile `paper`, the paper taken literally", profile="paper", geometry="box"),
    Method(name="fixed", about="lights tuned at this flow and ratio, then frozen", control="fixed", plan="same"),
    Method(name="fixed-held", about="lights tuned at a ratio of 1:1 and kept", control="fixed", plan="even"),
    Method(name="actuated", about="SUMO's gap-based lights, tuned likewise", control="actuated", plan="same"),
    Method(name="all-way-stop", about="SUMO's own all-way stop", control="all-way-stop"),
    Method(name="own", about="the net's own control, under SUMO's drivers", control="own"),
)
_BOX = ("stop-sign",)
"""Configurations that are measured with box geometry only."""


def known() -> dict[str, Method]:
    """Every method by name: those above, and one for each configuration."""
    methods = {method.name: method for method in _FIXED}
    for path in sorted(CONFIGURATIONS.glob("*.toml")):
        methods[path.stem] = Method(
            name=path.stem,
            about=path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# "),
            configuration=path,
            geometry="box" if path.stem in _BOX else None,
        )
    return methods


def named(name: str) -> Method:
    """A method by its name, or by NAME@GEOMETRY to fix its geometry. Raises `MethodError`."""
    base, at, geometry = name.partition("@")
    methods = known()
    if base not in methods:
        raise MethodError(f"{base!r} is not a method; allowed: {', '.join(methods)}")
    method = methods[base]
    if not at:
        return method
    if geometry not in ("areas", "box") or not method.ours:
        raise MethodError(f"{name!r}: allowed after @: areas, box, and only for methods of our manager")
    chosen: Geometry = "areas" if geometry == "areas" else "box"
    if method.geometry not in (None, chosen):
        raise MethodError(f"{name!r}: {base} is measured with {method.geometry} geometry only")
    return replace(method, name=name, geometry=chosen)


def check_goes_with(method: Method, sumo: Path | None) -> None:
    """Refuse what needs a generated scenario on a net of the user's own. Raises `MethodError`."""
    if sumo is not None and method.plan is not None:
        fine = ", ".join(name for name, other in known().items() if other.plan is None)
        raise MethodError(f"{method.name} needs a generated scenario to be tuned on; allowed with --sumo: {fine}")
