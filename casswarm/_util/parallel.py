"""Jobs in several processes, or wherever an executor sends them; none is lost."""

from __future__ import annotations

import multiprocessing
import pickle
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from numbers import Integral
from typing import Any, Protocol, TypeVar, runtime_checkable

from ..errors import PolicyError, WorkerError
from .interrupts import begin_child, blocked, interruptible

T = TypeVar("T")


@runtime_checkable
class SubmitsJobs(Protocol):
    """An executor in the style of `concurrent.futures`: `submit` returns a future."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Begin function(*arguments) and return its `concurrent.futures.Future`."""


Workers = int | SubmitsJobs
"""A number of processes, or an executor."""

_ONE_AT_A_TIME = threading.Lock()  # in a process: threads must not share CasADi's functions

_FRUITLESS = 2  # pools that may die in a row without one job done

_GUARD = (
    "in a script, use more than one only under `if __name__ == '__main__':`, and never from "
    "standard input; where memory is short, use fewer; or use workers=1"
)


def checked_workers(workers: Workers) -> Workers:
    """`workers` as it is.

    Raises
    ------
    ValueError
        Neither a whole number from 1 nor an executor.
    """
    whole = isinstance(workers, Integral) and int(workers) >= 1
    if not (whole or isinstance(workers, SubmitsJobs)):
        raise ValueError(
            f"workers = {workers!r}; allowed: whole numbers from 1, or an executor with submit()"
        )
    return workers


def done_jobs(jobs: Sequence[Callable[[], T]], workers: Workers) -> Iterator[tuple[int, T]]:
    """Every job's place and result, as they are done.

    Parameters
    ----------
    jobs : sequence of callables without arguments
        They pickle, unless `workers` is 1.
    workers : int or executor
        1 does them here, one after the other. An executor is neither started nor shut down. Jobs
        in one process wait for each other, so threads bring nothing.

    Raises
    ------
    WorkerError
        Processes died again and again without finishing a job, or the executor lost its workers.
    Exception
        What a job raises.
    """
    if isinstance(workers, SubmitsJobs):
        try:
            yield from _gathered(workers, dict(enumerate(jobs)))
        except Exception as error:
            if not _lost(error):
                raise
            raise WorkerError(f"the executor lost its workers: {error or type(error)}") from error
    elif workers == 1:
        for place, job in enumerate(jobs):
            with interruptible():  # CasADi loses an interrupt that comes while it builds
                result = job()
            yield place, result
    else:
        yield from _in_processes(jobs, int(workers))


def require_sendable(jobs: Mapping[str, Any]) -> None:
    """Raise PolicyError for what does not pickle; a pool whose tasks do not ends untidily.

    Parameters
    ----------
    jobs : mapping of policy name to job
    """
    for policy, job in jobs.items():
        try:
            pickle.dumps(job)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise PolicyError(
                f"policy {policy!r}, or the scenario's hazard, cannot be sent to a worker "
                f"({error}): define its function in a module, or use workers=1"
            ) from error


def _gathered(pool: SubmitsJobs, jobs: dict[int, Callable[[], T]]) -> Iterator[tuple[int, T]]:
    with blocked():  # which processes that are started now inherit
        futures: dict[Future[T], int] = {pool.submit(_call, job): at for at, job in jobs.items()}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def _lost(error: Exception) -> bool:
    """Whether an executor failed, and not a job: of the standard library's errors, or Dask's."""
    theirs = type(error).__module__.partition(".")[0] == "distributed"
    return theirs or isinstance(error, BrokenExecutor | CancelledError)


def _call(job: Callable[[], T]) -> T:
    with _ONE_AT_A_TIME:
        return job()


def _in_processes(jobs: Sequence[Callable[[], T]], workers: int) -> Iterator[tuple[int, T]]:
    """In processes of our own; where one dies, the jobs that were lost are done again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise PolicyError(f"a worker process cannot have workers of its own: {_GUARD}")
    left, fruitless = dict(enumerate(jobs)), 0
    while left:
        pool = _pool(min(workers, len(left)))
        try:
            for place, result in _gathered(pool, dict(left)):
                del left[place]
                fruitless = 0
                yield place, result
        except BrokenProcessPool as error:
            _end(pool)
            fruitless += 1
            if fruitless >= _FRUITLESS:
                raise WorkerError(
                    f"a worker process died, and the next one too: {_GUARD}"
                ) from error
        except BaseException:  # nobody waits for work that nobody will read
            _end(pool)
            raise
        else:
            pool.shutdown()


def _pool(workers: int) -> ProcessPoolExecutor:
    # spawned, not forked: CasADi and Ipopt's linear solver do not survive a fork of their threads
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=begin_child)


def _end(pool: ProcessPoolExecutor) -> None:
    for process in list((pool._processes or {}).values()):
        process.terminate()
    pool.shutdown(cancel_futures=True)  # waits for the dead, so that no semaphore is left behind
