"""Who solves what: small jobs stay here, large ones are spread."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gameopt_im.core.horizon import LONGEST
from gameopt_im.solver.horizon_job import PlatoonJob
from gameopt_im.solver.shares import SENDING, share_out


def test_what_is_lighter_than_the_way_to_a_worker_stays_here() -> None:
    assert share_out([1.0, 2.0, 1.0], 2) == [[1, 0, 2], [], []]


def test_without_workers_all_is_done_here() -> None:
    assert share_out([100.0, 200.0], 0) == [[1, 0]]


def test_heavy_jobs_are_spread() -> None:
    assert share_out([50.0, 60.0, 55.0], 2) == [[1], [2], [0]]


def test_full_platoons_are_worth_a_workers_while_and_a_few_vehicles_are_not() -> None:
    full, single = (PlatoonJob(np.zeros((count, 127)), (1.0,) * 8, 1e-3).weight() for count in (LONGEST, 1))
    assert [len(share) for share in share_out([full] * 8, 1)] == [6, 2]
    assert share_out([single] * 12, 1)[1] == []


@given(weights=st.lists(st.integers(1, 10), max_size=40), workers=st.integers(0, 4))
def test_each_job_is_in_one_share_and_nobody_could_have_done_it_much_sooner(weights: list[int], workers: int) -> None:
    shares = share_out(weights, workers)
    assert sorted(place for share in shares for place in share) == list(range(len(weights)))
    done = [sum(weights[place] for place in share) + (SENDING if who else 0.0) for who, share in enumerate(shares)]
    busy = [at for at, share in zip(done, shares, strict=True) if share]
    if busy:  # the last to end was the first to be free when it took its last job
        last = max(range(len(shares)), key=lambda who: done[who] if shares[who] else -1.0)
        began = done[last] - weights[shares[last][-1]]
        assert all(began <= other + 1e-9 for other in done)
        assert max(busy) == pytest.approx(done[last])
