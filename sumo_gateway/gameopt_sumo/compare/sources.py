"""What shapes a result beside its settings: our own files, to the byte, and the versions of the libraries."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from gameopt_wire import WIRE_VERSION

PACKAGES = ("gameopt_wire", "gameopt_im", "gameopt_vehicles", "gameopt_sumo")
LIBRARIES = ("gameopt", "eclipse-zenoh", "osqp", "eclipse-sumo", "libsumo", "numpy", "numba", "scipy")
OPTIONAL = ("pyscipopt",)
"""Needed for one experiment alone, so that it may be installed later."""
SHAPING = (".py", ".toml", ".json")
READERS = frozenset(
    f"{name}.py" for name in ("claims", "page", "plots", "preface", "reasons", "results", "verdicts", "views")
)
"""Of the comparison: they read runs and shape none, so a page may be corrected without driving them again."""


def versions() -> dict[str, str]:
    """Of everything that shapes a result; `code` is the digest of our own files, for the version stays the same."""
    return {
        "code": code_digest(folders()),
        "wire": str(WIRE_VERSION),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        **{name: found for name in OPTIONAL if (found := _installed(name)) is not None},
    }


def folders() -> list[Path]:
    """The packages of this project that are there, found without importing them."""
    found = (find_spec(name) for name in PACKAGES)
    return [Path(spec.origin).parent for spec in found if spec is not None and spec.origin is not None]


def code_digest(packages: Iterable[Path]) -> str:
    """The beginning of the SHA-256 over the names and bytes of all files that shape a result."""
    total = hashlib.sha256()
    for package in packages:
        for file in _shaping(package):
            total.update(f"{package.name}/{file.relative_to(package).as_posix()}\0".encode())
            total.update(hashlib.sha256(file.read_bytes()).digest())
    return total.hexdigest()[:16]


def _shaping(package: Path) -> Iterator[Path]:
    for file in sorted(package.rglob("*")):
        reads_only = file.parent.name == "compare" and file.name in READERS
        if file.suffix in SHAPING and not reads_only:
            yield file


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
