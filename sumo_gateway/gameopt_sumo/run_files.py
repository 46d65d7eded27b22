"""What a .sumocfg says, and SUMO's messages kept off the user's terminal."""

from __future__ import annotations

import os
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from types import TracebackType
from typing import NamedTuple


class SimulationError(Exception):
    """The simulation cannot start or go on; one line that says what and where."""


ENFORCED_OPTIONS = (
    ("--step-length", "0.1"),
    ("--step-method.ballistic", "true"),
    ("--collision.action", "warn"),
    ("--collision.check-junctions", "true"),
    ("--collision.mingap-factor", "0"),
    ("--collision.stoptime", "0"),
    ("--time-to-teleport", "-1"),
)
"""These win over the .sumocfg. Its outputs (fcd, tripinfo) stay as it says."""
QUIET_OPTIONS = (
    ("--no-warnings", "true"),
    ("--no-step-log", "true"),
    ("--duration-log.disable", "true"),
    ("--xml-validation", "never"),
)
"""Given unless the caller gives others."""


def sumo_arguments(sumocfg: Path, seed: int, own: Sequence[str]) -> list[str]:
    """SUMO's command line; `own` are the caller's options. Raises `SimulationError` for one that is fixed."""
    given = {argument.partition("=")[0] for argument in own if argument.startswith("-")}
    enforced = (("--seed", str(seed)), *ENFORCED_OPTIONS)
    for name, value in enforced:
        if name in given:
            raise SimulationError(f"SUMO option {name} is fixed to {value} here; leave it out")
    quiet = [option for option in QUIET_OPTIONS if option[0] not in given]
    return ["-c", str(sumocfg), *own, *(text for option in (*quiet, *enforced) for text in option)]


def net_file_of(sumocfg: Path, own: Sequence[str] = ()) -> Path:
    """The net that SUMO will load: the one that its `own` options name, else the .sumocfg.

    Raises `SimulationError` if the .sumocfg is missing or broken, or no net is named.
    """
    if not sumocfg.is_file():
        raise SimulationError(f"{sumocfg}: no such file; a SUMO configuration (.sumocfg) is needed")
    try:
        root = ET.parse(sumocfg).getroot()
    except (ET.ParseError, UnicodeDecodeError, OSError) as error:
        raise SimulationError(f"{sumocfg}: not a SUMO configuration: {error}") from None
    if named := _option_value(own, {"--net-file", "--net", "-n"}):
        return Path(named)
    for name in ("net-file", "net", "n"):
        option = root.find(f".//{name}")
        if option is not None and (value := option.get("value") or option.get("v")):
            return sumocfg.parent / value
    raise SimulationError(f"{sumocfg}: names no net; <net-file value=.../> is needed under <input>")


def _option_value(own: Sequence[str], names: set[str]) -> str | None:
    """What the last of these options is set to, as `--name VALUE` or `--name=VALUE`."""
    found = None
    for argument, following in zip_longest(own, own[1:]):
        name, equals, value = argument.partition("=")
        if name in names:
            found = value if equals else following
    return found


class NominalDemand(NamedTuple):
    """The demand a scenario was written with; None where nobody knows, as in a foreign one."""

    flow_veh_h: float | None = None
    ratio: float | None = None
    """Flow of west and east together over that of north and south together."""

    def note(self) -> str:
        """The line at the head of a route file that says so, a processing instruction: not for SUMO."""
        known = [f' {name}="{value!r}"' for name, value in self._asdict().items() if value is not None]
        return f"<?{NOTE}{''.join(known)}?>"


NOTE = "gameopt"
_NOTED = re.compile(r'(\w+)="([0-9.e+-]+)"')
_REPLACES_DEMAND = {"--route-files", "--routes", "-r", "--scale"}


def nominal_demand(sumocfg: Path, own: Sequence[str]) -> NominalDemand:
    """What a .sumocfg's one route file notes of its demand, unless SUMO's `own` options replace it."""
    if _REPLACES_DEMAND & {argument.partition("=")[0] for argument in own}:
        return NominalDemand()
    try:
        root = ET.parse(sumocfg).getroot()
        if root.find(".//scale") is not None:
            return NominalDemand()
        names = ("route-files", "routes", "r")
        routes = next((found for name in names for found in root.iter(name)), None)
        value = (routes.get("value") or routes.get("v")) if routes is not None else None
        if not value or "," in value:
            return NominalDemand()
        for event, found in ET.iterparse(sumocfg.parent / value, events=("pi", "start")):
            if event == "start":
                break
            target, _, text = (found.text or "").partition(" ")
            if target == NOTE:
                noted = {name: float(number) for name, number in _NOTED.findall(text)}
                return NominalDemand(noted.get("flow_veh_h"), noted.get("ratio"))
    except (ET.ParseError, ValueError, OSError):
        pass  # SUMO will say what is wrong with it
    return NominalDemand()


class Hush:
    """Keeps what SUMO's own code writes to stdout and stderr, whenever the `with` block is entered."""

    def __init__(self) -> None:
        self._catch = tempfile.TemporaryFile(mode="w+b")  # noqa: SIM115 - lives as long as the run
        self._saved: list[int] = []

    def __enter__(self) -> Hush:
        self._saved = [os.dup(1), os.dup(2)]
        os.dup2(self._catch.fileno(), 1)
        os.dup2(self._catch.fileno(), 2)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, saved in zip((1, 2), self._saved, strict=True):
            os.dup2(saved, number)
            os.close(saved)

    def reason(self, otherwise: str) -> str:
        """SUMO's first line that says what is wrong, without its prefix."""
        self._catch.seek(0)
        lines = self._catch.read().decode("utf-8", "replace").splitlines()
        at = next((i for i, line in enumerate(lines) if line.strip().startswith("Error:")), None)
        if at is None:
            return " ".join(otherwise.split()) or "no message from SUMO"
        text = lines[at].strip().removeprefix("Error:")
        if text.endswith(":") and at + 1 < len(lines):
            text += " " + lines[at + 1]
        return " ".join(text.split())

    def close(self) -> None:
        """Drop what was kept."""
        self._catch.close()
