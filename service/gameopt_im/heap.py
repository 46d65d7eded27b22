"""The heap of the process: one for all of Zenoh's threads, and as large from the start as traffic will make it."""

from __future__ import annotations

import ctypes
import sys

M_ARENA_MAX = -8
"""glibc's number for the most heaps of a process."""
RESERVED = 8 * 2**20
"""Twice as much as a manager's heap was seen to grow by, 4 MB in the first three minutes of 260 vehicles."""


def share_one() -> None:
    """One heap for all threads, where glibc gives nearly every thread its own; to be called before there are any.

    Zenoh's threads allocate for each other. In heaps of their own what is left of one vehicle does not fit the next:
    5.5 kB for each that comes, most of which one heap uses again.
    """
    library = _glibc()
    if library is not None:
        library.mallopt(M_ARENA_MAX, 1)


def reserve(size: int = RESERVED) -> None:
    """So many bytes that are free, and whose pages are there, to be called once all that stays has been allocated.

    Otherwise the heap grows in the first minutes by what is in the way of each other at the worst of moments, and the
    control cycle in which a page is touched for the first time waits for it.
    """
    library = _glibc()
    if library is None:
        return
    library.malloc.restype = ctypes.c_void_p
    # The first is a mapping of its own. Once it is freed, glibc takes as much from the heap, and leaves it there.
    for bytes_ in (size, size - 2**16):
        taken = ctypes.c_void_p(library.malloc(ctypes.c_size_t(bytes_)))
        if taken:
            ctypes.memset(taken, 0, bytes_)
        library.free(taken)


def _glibc() -> ctypes.CDLL | None:
    """The C library, where it is glibc: others have no such heaps."""
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    return library if hasattr(library, "mallopt") else None
