"""Real-time scheduling: a control cycle goes before whatever else its machine has to do."""

from __future__ import annotations

import os
import sys

PRIORITY = 10
"""Of 1 to 99: before all ordinary processes, behind what a system runs at real time itself."""


def go_first() -> bool:
    """Schedule every thread that this process has now before all ordinary ones (SCHED_FIFO); whether the system let it.

    Threads and processes that are begun later are ordinary ones. Linux lets root do this, whoever has CAP_SYS_NICE, and
    whose RLIMIT_RTPRIO is high enough. It takes the processor away for 50 ms of a second at the least from whoever
    would keep it (`kernel.sched_rt_runtime_us`).
    """
    if sys.platform != "linux":
        return False
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    for thread in map(int, os.listdir("/proc/self/task")):
        try:
            os.sched_setscheduler(thread, policy, os.sched_param(PRIORITY))
        except ProcessLookupError:
            continue  # it has ended
        except PermissionError:
            return False
    return True
