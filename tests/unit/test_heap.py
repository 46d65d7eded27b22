"""One heap for all threads, asked of the C library itself in a process of its own."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have one heap anyway")

HEAPS = """
import ctypes, sys, threading
from gameopt_im import heap
if sys.argv[1] == "one":
    heap.share_one()
libc = ctypes.CDLL(None)
ready = threading.Barrier(9)
def allocate():
    libc.malloc(5000)
    ready.wait()
    ready.wait()
threads = [threading.Thread(target=allocate) for _ in range(8)]
for each in threads: each.start()
ready.wait()
libc.malloc_info(0, ctypes.c_void_p.in_dll(libc, "stdout"))
libc.fflush(None)
ready.wait()
"""


@pytest.mark.parametrize(("how", "one"), [("one", True), ("many", False)])
def test_threads_share_one_heap_when_asked_to(how: str, one: bool) -> None:
    done = subprocess.run([sys.executable, "-c", HEAPS, how], capture_output=True, text=True, check=True)
    assert (done.stdout.count("<heap nr=") == 1) is one
