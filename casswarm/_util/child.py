"""Jobs in several processes or on an executor; jobs of a process that dies are repeated."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import current_process, get_context
from numbers import Integral
from typing import Any, Protocol, TypeVar, runtime_checkable

from ..errors import PolicyError, WorkerError
from .interrupts import begin_child, blocked, interruptible
from .threads import ONE_JOB

T = TypeVar("T")


@runtime_checkable
class SubmitsJobs(Protocol):
    """An executor in the style of `concurrent.futures`: `submit` returns a future."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Start function(*arguments) and return its `concurrent.futures.Future`."""


Workers = int | SubmitsJobs
"""A number of processes, or an executor."""

_GUARD = (
    "in a script, use more than one only under `if __name__ == '__main__':`, and never from "
    "standard input; where memory is short, use fewer; or use workers=1"
)


def require_workers(workers: Workers) -> None:
    """Raise ValueError for workers that are neither a whole number from 1 nor an executor."""
    valid = isinstance(workers, Integral) and int(workers) >= 1
    if not (valid or isinstance(workers, SubmitsJobs)):
        raise ValueError(
            f"workers = {workers!r}; allowed: whole numbers from 1, or an executor with submit()"
        )


def done_jobs(jobs: Sequence[Callable[[], T]], workers: Workers) -> Iterator[tuple[int, T]]:
    """Yield the index and result of every job as soon as it is finished.

    Parameters
    ----------
    jobs : sequence of callables without arguments
        They pickle, unless `workers` is 1. Functions and classes of a notebook or a script are sent
        to processes by value.
    workers : int or executor
        1 runs them in this process, one after the other. An executor is neither started nor shut
        down. Jobs in threads of one process take turns: see `casswarm._util.threads.ONE_JOB`.

    Raises
    ------
    WorkerError
        Processes died repeatedly without finishing a job, or the executor lost its workers.
    Exception
        What a job raises.
    """
    if isinstance(workers, SubmitsJobs):
        try:
            yield from _gathered(workers, dict(enumerate(jobs)))
        except Exception as error:
            # not a job's error, but one of the executor: the standard library's or Dask's
            from_dask = type(error).__module__.partition(".")[0] == "distributed"
            if not (from_dask or isinstance(error, BrokenExecutor | CancelledError)):
                raise
            raise WorkerError(f"the executor lost its workers: {error or type(error)}") from error
    elif workers == 1:
        for index, job in enumerate(jobs):
            with interruptible():  # CasADi loses an interrupt that comes while it builds
                result = job()
            yield index, result
    else:
        yield from _in_processes(jobs, int(workers))


def require_sendable(jobs: Mapping[str, Any]) -> None:
    """Raise PolicyError for jobs, by policy, that do not pickle: a pool reports them unclearly."""
    for policy, job in jobs.items():
        try:
            packed(job)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise PolicyError(
                f"policy {policy!r}, or the scenario's hazard, cannot be sent to a worker "
                f"({error}): its function or object holds something that does not pickle; make "
                "that where it is used, or use workers=1"
            ) from error


def packed(value: Any) -> bytes:
    """Pickle of a value, and of what it refers to in a notebook or a script, by value.

    `pickle.loads` reads it.
    """
    import cloudpickle

    content: bytes = cloudpickle.dumps(value)
    return content


def _gathered(pool: SubmitsJobs, jobs: dict[int, Callable[[], T]]) -> Iterator[tuple[int, T]]:
    by_value = isinstance(pool, ProcessPoolExecutor)  # others pickle in ways of their own
    with blocked():  # inherited by the processes that are started now
        futures: dict[Future[T], int] = {
            pool.submit(_call_packed, packed(job)) if by_value else pool.submit(_call, job): at
            for at, job in jobs.items()
        }
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def _call(job: Callable[[], T]) -> T:
    with ONE_JOB:
        return job()


def _call_packed(content: bytes) -> Any:
    return _call(pickle.loads(content))


def _in_processes(jobs: Sequence[Callable[[], T]], workers: int) -> Iterator[tuple[int, T]]:
    """Run jobs in a pool of processes; if one dies, run the unfinished jobs again."""
    if getattr(current_process(), "_inheriting", False):
        raise PolicyError(f"a worker process cannot have workers of its own: {_GUARD}")
    unfinished, died = dict(enumerate(jobs)), False
    while unfinished:
        # spawned: the threads of CasADi and of Ipopt's linear solver do not survive a fork
        pool = ProcessPoolExecutor(
            min(workers, len(unfinished)), get_context("spawn"), initializer=begin_child
        )
        try:
            for index, result in _gathered(pool, dict(unfinished)):
                del unfinished[index]
                died = False
                yield index, result
            pool.shutdown()
        except BrokenProcessPool as error:
            if died:
                raise WorkerError(
                    f"a worker process died, and the next one too: {_GUARD}"
                ) from error
            died = True
        finally:  # do not wait for results that will not be read
            for process in list((pool._processes or {}).values()):
                process.terminate()
            pool.shutdown(cancel_futures=True)  # waits for the processes, which releases semaphores
