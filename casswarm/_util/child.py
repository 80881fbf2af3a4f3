"""Child processes: one that answers what it is sent, and pools of them that run jobs.

They ignore Ctrl-C, which is their parent's, and end when it ends. They are spawned: the threads of
CasADi, of Ipopt's linear solver and of other compiled libraries do not survive a fork.
"""

from __future__ import annotations

import os
import pickle
import signal
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
from contextlib import suppress
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import Connection
from numbers import Integral
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar, runtime_checkable

from ..errors import PolicyError, WorkerError
from .interrupts import blocked, deferred, interruptible
from .text import shown
from .threads import ONE_JOB

T = TypeVar("T")

_END_SECONDS = 60.0  # until a process that has closed its connection ends
_MAX_OUTPUT = 500  # characters in which the last line that a process printed is looked for


class ChildEndedError(Exception):
    """The process ended before it answered; the message says how."""


class ChildTimeoutError(ChildEndedError):
    """The process did not answer in time; who asked should end it."""


class Child:
    """A process that answers what it is sent, until its parent ends it or ends.

    Not an executor: those of `concurrent.futures` have no time limit and report no exit codes.
    Answers are either waited for (`ask`) or listened to (`listen`).

    Parameters
    ----------
    serve : callable
        Called in the process with its `Channel`; a function of a module, or a `partial` of one.
    output : Path, optional
        File for what the process prints.

    Raises
    ------
    OSError, AssertionError
        The process cannot be started.
    """

    def __init__(self, serve: Callable[[Channel], None], output: Path | None = None) -> None:
        context, self._output = get_context("spawn"), output
        self._connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, serve, output), daemon=True)
        try:
            with deferred():
                self.process.start()
        except BaseException:
            self.end()
            raise
        finally:
            theirs.close()

    def send(self, request: bytes) -> None:
        """Send a request; OSError if the process has ended."""
        self._connection.send_bytes(request)

    def ask(self, request: bytes, seconds: float) -> bytes:
        """Send a request, unless it is empty, and wait for the answer; ChildEndedError without."""
        try:
            if request:
                self.send(request)
            if self._connection.poll(seconds):
                return self._connection.recv_bytes()
        except (EOFError, OSError):
            self.process.join(_END_SECONDS)
            raise ChildEndedError(self._description()) from None
        raise ChildTimeoutError(f"no answer within {seconds:g} s, so its process was ended")

    def listen(self, receive: Callable[[bytes], None]) -> None:
        """Call a function with every answer, in a thread; with b"" when the process has ended."""
        threading.Thread(target=_read, args=(self._connection, receive), daemon=True).start()

    def end(self) -> None:
        """End the process, whatever it is doing, and wait for that."""
        if self.process.pid is not None:  # else it was never started
            self.process.kill()
            self.process.join()

    def _description(self) -> str:
        """Exit code of the process, and the last line that it printed."""
        code = self.process.exitcode
        text = f"its process ended with exit code {code}"
        if code is not None and code < 0:
            with suppress(ValueError):
                text += f" ({signal.Signals(-code).name})"
        printed = self._output.read_text("utf-8", "replace") if self._output else ""
        lines = (line.strip() for line in reversed(printed[-_MAX_OUTPUT:].split("\n")))
        last = next(filter(None, lines), "")
        return f"{text}; the last line that it printed: {last}" if last else text


class Channel:
    """A child's connection to its parent. Requests are read at once, so sending never waits."""

    def __init__(self, connection: Connection[Any, Any]) -> None:
        self._connection = connection
        self._requests: SimpleQueue[bytes] = SimpleQueue()
        threading.Thread(target=_read, args=(connection, self._requests.put), daemon=True).start()

    def requests(self) -> Iterator[bytes]:
        """Yield requests until the parent ends."""
        yield from iter(self._requests.get, b"")

    @property
    def waiting(self) -> bool:
        """True if there is a request that was not yielded yet."""
        return not self._requests.empty()

    def send(self, answer: bytes) -> None:
        """Send an answer."""
        self._connection.send_bytes(answer)


def _read(connection: Connection[Any, Any], receive: Callable[[bytes], object]) -> None:
    with suppress(EOFError, OSError):
        while True:
            receive(connection.recv_bytes())
    receive(b"")


def _serve(
    connection: Connection[Any, Any], serve: Callable[[Channel], None], output: Path | None
) -> None:
    _begin()
    if output is not None:
        file = os.open(output, os.O_WRONLY | os.O_TRUNC)
        os.dup2(file, 1)
        os.dup2(file, 2)
    serve(Channel(connection))


def _begin() -> None:
    """Ignore Ctrl-C in this child process, and end it when its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if parent := parent_process():
        parent.join()
        os._exit(1)


# --- jobs, in pools of processes or on an executor


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
            f"workers = {shown(workers)}; allowed: whole numbers from 1, or an executor with "
            "submit()"
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


def _gathered(
    pool: SubmitsJobs, jobs: dict[int, Callable[[], T]], cancel: bool = True
) -> Iterator[tuple[int, T]]:
    from .. import __version__

    by_value = isinstance(pool, ProcessPoolExecutor)  # others pickle in ways of their own
    with blocked():  # inherited by the processes that are started now
        futures: dict[Future[T], int] = {
            pool.submit(_call_packed, packed(job))
            if by_value
            else pool.submit(_call_of_version, __version__, job): at
            for at, job in jobs.items()
        }
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures if cancel else ():
            future.cancel()


def _call(job: Callable[[], T]) -> T:
    with ONE_JOB:
        return job()


def _call_of_version(version: str, job: Callable[[], T]) -> T:
    """Run a job of a process that may be on another machine, if casswarm is the same there."""
    from .. import __version__

    if version != __version__:
        raise WorkerError(
            f"a worker has casswarm {__version__}, and the process that asks has {version}: their "
            "results may differ, so install the same version for both",
            version=version,
            worker_version=__version__,
        )
    return _call(job)


def _call_packed(content: bytes) -> Any:
    return _call(pickle.loads(content))


def _in_processes(jobs: Sequence[Callable[[], T]], workers: int) -> Iterator[tuple[int, T]]:
    """Run jobs in a pool of processes; if one dies, run the unfinished jobs again."""
    if getattr(current_process(), "_inheriting", False):
        raise PolicyError(f"a worker process cannot have workers of its own: {_GUARD}")
    unfinished, died = dict(enumerate(jobs)), False
    while unfinished:
        pool = ProcessPoolExecutor(
            min(workers, len(unfinished)), get_context("spawn"), initializer=_begin
        )
        try:
            # not cancelled here: the pool's thread fails on cancelled jobs of ended processes
            for index, result in _gathered(pool, dict(unfinished), cancel=False):
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
