"""One heap for all threads, and room in it: asked of the C library itself, and the system, in a fresh process."""

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


GROWTH = """
import ctypes, sys
from gameopt_im import heap
def resident_kb():
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
if sys.argv[1] == "reserved":
    heap.reserve()
before = resident_kb()
for _ in range(600):
    ctypes.memset(libc.malloc(10_000), 1, 10_000)
print(resident_kb() - before)
"""


@pytest.mark.parametrize(("how", "least", "most"), [("reserved", 0, 1_000), ("not", 5_000, 10_000)])
def test_what_is_reserved_need_not_be_asked_for_later(how: str, least: int, most: int) -> None:
    done = subprocess.run([sys.executable, "-c", GROWTH, how], capture_output=True, text=True, check=True)
    assert least <= int(done.stdout) <= most
