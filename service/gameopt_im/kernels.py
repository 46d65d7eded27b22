"""Where the compiled kernels of the core are cached: a folder named after the sources they were made from.

The compiler's own cache looks at one file at a time and would miss a change in a rule that another file inlines.
A stale rule is a safety fault, so every change of any source starts a fresh cache.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numba

import gameopt_wire


def use_source_keyed_cache() -> None:
    """Point the compiler's cache at a folder of these sources; an explicit NUMBA_CACHE_DIR is respected."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    sources = [
        Path(gameopt_wire.__file__).with_name("motion.py"),
        *sorted((Path(__file__).parent / "core").glob("*.py")),
    ]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    numba.config.CACHE_DIR = str(home / "gameopt" / f"kernels-{digest}")  # type: ignore[attr-defined]
