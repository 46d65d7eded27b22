"""Real-time scheduling, in processes of their own: it would hold for every test after it."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys

import pytest

from gameopt_im.solver.pool import Pool

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="SCHED_FIFO by thread is Linux's")

ASKING = """
import os, subprocess, sys, threading
from gameopt_im import scheduling
asleep = threading.Event()
threading.Thread(target=asleep.wait, daemon=True).start()
print(int(scheduling.go_first()))
print(*(os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")))
print(subprocess.run([sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"], capture_output=True).stdout)
"""
FIRST = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if sys.platform == "linux" else 0


def may_go_first() -> bool:
    """Whether this system lets a process like this one, by asking it without this package."""
    trial = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))"
    return subprocess.run([sys.executable, "-c", trial], stderr=subprocess.DEVNULL, check=False).returncode == 0


def test_every_thread_goes_first_where_the_system_lets_it_and_none_begun_later() -> None:
    done = subprocess.run([sys.executable, "-c", ASKING], capture_output=True, text=True, check=True)
    said, threads, child = done.stdout.splitlines()
    let = may_go_first()
    assert said == str(int(let))
    policies = [int(policy) for policy in threads.split()]
    assert len(policies) >= 2
    assert set(policies) == {FIRST if let else os.SCHED_OTHER}
    assert str(os.SCHED_OTHER) in child


@pytest.mark.parametrize("go_first", [False, True])
def test_a_worker_goes_first_if_it_is_to(go_first: bool) -> None:
    async def policy() -> int | None:
        async with Pool[int, int](1, "os:sched_getscheduler", go_first=go_first) as pool:
            (found,) = await pool.solve([0])
            return found

    assert asyncio.run(policy()) == (FIRST if go_first and may_go_first() else os.SCHED_OTHER)
