"""The junctions of `tests/maps/plain`, described in a few lines each and built by netconvert."""

from __future__ import annotations

from pathlib import Path

from gameopt_sumo.scenarios import build_net

PLAIN = Path(__file__).parent / "plain"
NAMES = ("t-junction", "five-arm", "single-lane", "shared-lane")
CENTRE = "centre"
"""Every one of them is at this node."""
_SUFFIX = {"node": "nod", "edge": "edg", "connection": "con"}


def build_plain(name: str, folder: Path, *options: str) -> Path:
    """The net of one of `NAMES`, or of any other description there; returns its file."""
    files = {kind: PLAIN / f"{name}.{suffix}.xml" for kind, suffix in _SUFFIX.items()}
    net = folder / f"{name}.net.xml"
    described = {kind: file.read_text() for kind, file in files.items() if file.exists()}
    build_net(described, net, ("--no-turnarounds", "true", *options))
    return net
