"""The pool with real processes: late, killed, failing workers, and the same results for any number of them.

Nothing sleeps: a job that is to be late waits on a FIFO until the test writes to it.
"""

from __future__ import annotations

import asyncio
import os
import select
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvloop
from builders import CONFLICT, random_traffic

from gameopt_im.core.parameters import Program
from gameopt_im.solver import jobs
from gameopt_im.solver.jobs import Outcome, PaperJob
from gameopt_im.solver.pool import Counts, Pool
from gameopt_im.solver.process import PoolError

SOLVE = "pool_jobs:solve"
SOON_S = 0.5
"""Deadline for what will not come by it whatever the machine does, but has begun by then on a busy machine too."""
AMPLE_S = 1.0
"""Deadline that an idle worker's echo meets on a busy machine too."""
Test = Callable[["Pool[Any, Any]"], Awaitable[None]]


@pytest.fixture(params=["asyncio", "uvloop"])
def loop_factory(request: pytest.FixtureRequest) -> Callable[[], asyncio.AbstractEventLoop] | None:
    return uvloop.new_event_loop if request.param == "uvloop" else None


def run(test: Test, workers: int, loop_factory: Callable[[], asyncio.AbstractEventLoop] | None = None) -> Counts:
    """Run a test in a pool of so many workers; returns what the pool counted."""

    async def inside() -> Counts:
        async with Pool[Any, Any](workers, SOLVE, [("echo", 0)]) as pool:
            await test(pool)
            return pool.counts

    with asyncio.Runner(debug=True, loop_factory=loop_factory) as runner:
        return runner.run(inside())


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    path = tmp_path / "fifo"
    os.mkfifo(path)
    return path


def in_s(seconds: float) -> float:
    return asyncio.get_running_loop().time() + seconds


@pytest.mark.parametrize("workers", [0, 1, 2, 3])
def test_results_come_in_the_order_of_the_jobs(workers: int, loop_factory: Any) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        for count in (0, 1, 2, 7):
            wanted = [f"job {i}" for i in range(count)]
            assert await pool.solve([("echo", each) for each in wanted]) == wanted
            assert await pool.solve([("echo", each) for each in wanted], in_s(60.0)) == wanted

    assert run(test, workers, loop_factory) == Counts(solved=20)


def test_large_jobs_pass_both_ways(loop_factory: Any) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        large = [np.full(300_000, float(i)) for i in range(3)]
        for sent, got in zip(large, await pool.solve([("echo", each) for each in large]), strict=True):
            np.testing.assert_array_equal(sent, got)

    run(test, 2, loop_factory)


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_a_job_that_fails_costs_itself_only(workers: int) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        assert await pool.solve([("fail", "as told"), ("echo", None), ("echo", 3)]) == [None, None, 3]
        assert pool.last_fault is not None
        assert "RuntimeError: as told" in pool.last_fault

    assert run(test, workers) == Counts(solved=1, failed=2)


def test_a_late_worker_costs_its_candidate_and_gets_nothing_new(fifo: Path, loop_factory: Any) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        late = ("wait", str(fifo))
        assert await pool.solve([late, ("echo", 1)], in_s(AMPLE_S)) == [None, 1]
        assert pool.counts == Counts(solved=1, late=1)
        assert await pool.solve([("echo", 2), ("echo", 3)], in_s(60.0)) == [2, 3]  # by the other alone
        await asyncio.to_thread(fifo.write_text, "too late")
        await pool.idle()
        assert await pool.solve([("echo", 4), ("echo", 5)]) == [4, 5]

    assert run(test, 2, loop_factory) == Counts(solved=5, late=1)


def test_with_every_worker_late_nothing_comes_and_nothing_waits(fifo: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        assert await pool.solve([("wait", str(fifo))], in_s(SOON_S)) == [None]
        assert await pool.solve([("echo", 1), ("echo", 2)], in_s(60.0)) == [None, None]
        writing = asyncio.create_task(asyncio.to_thread(fifo.write_text, "too late"))
        assert await pool.solve([("echo", 3)]) == [3]  # without a deadline the pool waits for its workers
        await writing

    assert run(test, 1) == Counts(solved=1, late=3)


def test_what_is_late_is_not_begun(fifo: Path, tmp_path: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        rest = ("touch", str(tmp_path / "begun"))
        assert await pool.solve([("wait", str(fifo)), rest], in_s(SOON_S)) == [None, None]
        await asyncio.to_thread(fifo.write_text, "too late")
        await pool.idle()

    assert run(test, 1) == Counts(late=2)
    assert not (tmp_path / "begun").exists()


def test_in_process_what_is_late_is_not_begun() -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        assert await pool.solve([("echo", 1)], in_s(-1.0)) == [None]

    assert run(test, 0) == Counts(late=1)


def test_a_worker_killed_at_work_costs_its_candidate(fifo: Path, loop_factory: Any) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        solving = asyncio.create_task(pool.solve([("hold", str(fifo)), ("echo", 1)], in_s(60.0)))
        os.kill(int(await asyncio.to_thread(fifo.read_text)), signal.SIGKILL)
        assert await solving == [None, 1]
        await pool.idle()  # the replacement is there
        assert await pool.solve([("echo", i) for i in range(4)]) == [0, 1, 2, 3]

    assert run(test, 2, loop_factory) == Counts(solved=5, failed=1, lost_workers=1)


def test_a_worker_killed_while_idle_is_replaced() -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        [(process, _)] = await pool.solve([("process", None)])
        os.kill(process, signal.SIGKILL)
        assert await pool.solve([("echo", 1)]) == [1]

    assert run(test, 1).solved == 2


def test_in_lock_step_what_a_killed_worker_owed_is_tried_again(fifo: Path, loop_factory: Any) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        solving = asyncio.create_task(pool.solve([("echo", 1), ("hold_once", str(fifo)), ("echo", 2)]))
        os.kill(int(await asyncio.to_thread(fifo.read_text)), signal.SIGKILL)
        assert await solving == [1, "again", 2]

    assert run(test, 1, loop_factory) == Counts(solved=3, lost_workers=1)


@pytest.mark.parametrize("workers", [1, 2])
def test_in_lock_step_a_job_that_kills_is_given_up_alone(workers: int) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        batch = [("echo", 1), ("die", None), ("echo", 2), ("echo", 3)]
        assert await pool.solve(batch) == [1, None, 2, 3]

    assert run(test, workers) == Counts(solved=3, failed=1, lost_workers=2)


def test_workers_leave_interrupts_to_the_parent() -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        [(process, group)] = await pool.solve([("process", None)])
        assert group != os.getpgid(0)
        os.kill(process, signal.SIGINT)
        assert await pool.solve([("process", None)]) == [(process, group)]

    assert run(test, 1) == Counts(solved=2)


def test_one_call_at_a_time(fifo: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        first = asyncio.create_task(pool.solve([("wait", str(fifo))]))
        await asyncio.sleep(0)
        with pytest.raises(RuntimeError, match="already solving"):
            await pool.solve([("echo", 1)])
        await asyncio.to_thread(fifo.write_text, "now")
        assert await first == ["now"]

    run(test, 1)


def test_a_cancelled_call_leaves_the_pool_usable(fifo: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        first = asyncio.create_task(pool.solve([("wait", str(fifo))]))
        await asyncio.sleep(0)
        first.cancel()
        with pytest.raises(asyncio.CancelledError):
            await first
        await asyncio.to_thread(fifo.write_text, "nobody listens")
        assert await pool.solve([("echo", 1)]) == [1]

    assert run(test, 1) == Counts(solved=1)


@pytest.mark.parametrize(
    ("solve", "warm_up", "complaint"),
    [
        ("pool_jobs:missing", [], "has no attribute 'missing'"),
        (SOLVE, [("fail", "too cold")], "RuntimeError: too cold"),
        (SOLVE, [("die", None)], "ended before it was ready"),
    ],
)
def test_a_worker_that_does_not_come_up_is_an_error(solve: str, warm_up: list[tuple[str, Any]], complaint: str) -> None:
    async def start() -> None:
        await Pool[Any, Any](2, solve, warm_up).start()

    with pytest.raises(PoolError, match=complaint):
        asyncio.run(start(), debug=True)


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="waits for a process that is not its child")
def test_workers_end_with_their_parent() -> None:
    program = (
        "import asyncio, os\n"
        "from gameopt_im.solver.pool import Pool\n"
        "async def main():\n"
        "    pool = Pool(1, 'pool_jobs:solve')\n"
        "    await pool.start()\n"
        "    [(process, _)] = await pool.solve([('process', None)])\n"
        "    print(process, flush=True)\n"
        "    await asyncio.Event().wait()\n"
        "asyncio.run(main())\n"
    )
    paths = os.pathsep.join(filter(None, sys.path))
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    ) as parent:
        assert parent.stdout is not None
        worker = os.pidfd_open(int(parent.stdout.readline()))
        parent.kill()
        ended, _, _ = select.select([worker], [], [], 30.0)
        os.close(worker)
    assert ended


def test_candidates_come_out_the_same_bits_for_any_number_of_workers() -> None:
    made = []
    for seed in range(6):
        vehicles, order = random_traffic(20, seed)
        other = np.argsort(vehicles.s, kind="stable")
        made += [PaperJob(vehicles, each, CONFLICT, Program()) for each in (order, other)]

    async def solve(workers: int) -> list[Outcome | None]:
        async with Pool[jobs.Job, Outcome](workers, jobs.SOLVE, jobs.warm_up()) as pool:
            return await pool.solve(made)

    results = [asyncio.run(solve(workers), debug=True) for workers in (0, 1, 2)]
    assert None not in results[0]
    bits = [
        [(each.speeds.tobytes(), each.objective, each.residual) for each in found if each is not None]
        for found in results
    ]
    assert bits[0] == bits[1] == bits[2]


LIGHT, HEAVY = 1.0, 100.0


def shared(test: Test, workers: int) -> Counts:
    """Run a test in a pool that shares with its workers; the weight of a job comes third."""

    async def inside() -> Counts:
        async with Pool[Any, Any](workers, SOLVE, [("echo", 0)], weigh=lambda job: float(job[2])) as pool:
            await test(pool)
            return pool.counts

    with asyncio.Runner(debug=True) as runner:
        return runner.run(inside())


def test_light_jobs_are_done_in_this_process_and_heavy_ones_shared() -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        here = os.getpid()
        assert {each[0] for each in await pool.solve([("process", None, LIGHT)] * 3)} == {here}
        spread = [each[0] for each in await pool.solve([("process", None, HEAVY)] * 4)]
        assert spread.count(here) == 2
        assert len(set(spread)) == 2
        assert await pool.solve([("echo", k, HEAVY) for k in range(7)], in_s(60.0)) == list(range(7))

    assert shared(test, 1) == Counts(solved=14)


def test_nothing_of_the_own_share_is_begun_after_the_deadline(tmp_path: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        marks = [tmp_path / f"{k}" for k in range(2)]
        assert await pool.solve([("touch", str(mark), LIGHT) for mark in marks], in_s(-1.0)) == [None, None]
        assert not any(mark.exists() for mark in marks)

    assert shared(test, 1) == Counts(late=2)


def test_with_its_worker_late_this_process_does_all_until_the_deadline(fifo: Path) -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        late, light = ("wait", str(fifo), LIGHT), ("echo", 0, 4 * HEAVY)  # the heavier is this process's
        assert await pool.solve([light, ("echo", 1, HEAVY), late], in_s(SOON_S)) in ([0, 1, None], [0, None, None])
        assert await pool.solve([("echo", 2, HEAVY), ("echo", 3, HEAVY)], in_s(60.0)) == [2, 3]
        await asyncio.to_thread(fifo.write_text, "too late")
        await pool.idle()

    shared(test, 1)


def test_a_worker_that_dies_while_this_process_is_at_its_own_share_is_replaced() -> None:
    async def test(pool: Pool[Any, Any]) -> None:
        assert await pool.solve([("echo", 1, HEAVY), ("die", None, HEAVY)]) == [1, None]
        assert sorted(each[0] == os.getpid() for each in await pool.solve([("process", None, HEAVY)] * 2)) == [
            False,
            True,
        ]

    assert shared(test, 1).lost_workers == 2
