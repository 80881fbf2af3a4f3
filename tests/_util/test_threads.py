"""Threads that plan, simulate and evaluate at once: the results of one thread, and no deadlock."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import python
from sweep_cases import SMALL

import casswarm as csw
from casswarm._util.child import done_jobs
from casswarm._util.threads import locked_cache, locked_property, one_at_a_time

EIGHT_THREADS = Path(__file__).parents[1] / "helpers" / "eight_threads.py"


def run_threads(repeats: int, seconds: int) -> None:
    python(EIGHT_THREADS, repeats, seconds, timeout=None)


@pytest.mark.slow
def test_eight_threads_give_results_of_one_thread() -> None:
    run_threads(repeats=1, seconds=100)


@pytest.mark.slow
def test_eight_threads_for_long_give_results_of_one_thread() -> None:
    run_threads(repeats=12, seconds=900)


def test_job_that_waits_for_solving_threads_runs_on_executor_of_threads() -> None:
    policy = csw.make_policy("constrained", SMALL, solver="ipopt")
    state = 0, SMALL.positions, np.zeros_like(SMALL.positions), np.ones(3, bool)

    def job() -> np.ndarray:
        with ThreadPoolExecutor(1) as own:
            return own.submit(policy.velocities, *state).result(60)

    with ThreadPoolExecutor(2) as pool:
        results = dict(done_jobs([job, job], pool))
    np.testing.assert_array_equal(results[0], policy.velocities(*state))
    np.testing.assert_array_equal(results[1], results[0])


def test_locked_cache_computes_once_in_many_threads() -> None:
    calls = []

    @locked_cache(maxsize=4)
    def slow(key: int) -> list[int]:
        time.sleep(0.05)
        calls.append(key)
        return [key]

    with ThreadPoolExecutor(8) as pool:
        values = list(pool.map(slow, [1] * 8))
    assert calls == [1]
    assert all(value is values[0] for value in values)
    slow.cache_clear()
    assert slow(1) is not values[0]


def test_decorated_functions_call_each_other_and_exclude_other_threads() -> None:
    inside, most = [], []

    @one_at_a_time
    def inner() -> None:
        inside.append(threading.get_ident())
        most.append(len(set(inside)))
        time.sleep(0.01)
        inside.remove(threading.get_ident())

    class Holder(SimpleNamespace):
        @locked_property
        def value(self) -> int:
            inner()
            return 3

    outer = one_at_a_time(inner)
    holders = [Holder() for _ in range(4)]
    with ThreadPoolExecutor(8) as pool:
        jobs = [pool.submit(outer) for _ in range(4)]
        assert list(pool.map(lambda holder: holder.value, holders)) == [3] * 4
        for job in jobs:
            job.result()
    assert set(most) == {1}
    assert vars(holders[0]) == {"value": 3}
