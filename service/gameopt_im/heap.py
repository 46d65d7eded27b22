"""The heap that Zenoh's threads share, so that memory does not grow with every vehicle that has ever come."""

from __future__ import annotations

import ctypes
import sys

M_ARENA_MAX = -8
"""glibc's number for the most heaps of a process."""


def share_one() -> None:
    """One heap for all threads, where glibc gives nearly every thread its own; to be called before there are any.

    Zenoh's threads allocate for each other. In heaps of their own what is left of one vehicle does not fit the next:
    5.5 kB for each that comes, most of which one heap uses again.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:  # other C libraries have no such heaps
        mallopt(M_ARENA_MAX, 1)
