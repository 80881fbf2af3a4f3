"""Threads: what only one may do at a time, and one thread of BLAS for small matrices.

CasADi's Python interface releases the interpreter's lock in every call, so several threads are in
its compiled code at once. Its functions may be evaluated so, since each call has memory of its own.
Two things are unsafe. Its solvers (Ipopt with MUMPS, and others) end the process with SIGSEGV, and
a solver's statistics are those of its last call, in whatever thread. Scalar expressions share
constants whose references are counted without a lock.

The functions that build expressions, functions and solvers, and every call of a solver, therefore
share one lock, at the lowest level. The public functions are no place for it: they wait for
executors and call users' functions, which may start threads that would wait for the lock forever. A
thread that has the lock waits for no other thread. Numba's kernels need no lock, so threads still
overlap in the batch solver.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, ParamSpec, TypeVar, cast

_Parameters = ParamSpec("_Parameters")
_Value = TypeVar("_Value")

_LOCK = threading.RLock()

ONE_JOB = threading.Lock()
"""Held by a job of an executor while it runs, so that jobs in threads of one process take turns:
they call users' policies, which need not be safe in threads. Taken before the lock above."""


def one_at_a_time(function: Callable[_Parameters, _Value]) -> Callable[_Parameters, _Value]:
    """Let one thread at a time run any of the functions and properties decorated in this module.

    They may call each other.
    """

    @functools.wraps(function)
    def alone(*args: _Parameters.args, **keywords: _Parameters.kwargs) -> _Value:
        with _LOCK:
            return function(*args, **keywords)

    return alone


def locked_cache(
    maxsize: int,
) -> Callable[[Callable[..., _Value]], functools._lru_cache_wrapper[_Value]]:
    """`functools.lru_cache` for `one_at_a_time`: threads share a value, which is computed once."""

    def decorated(function: Callable[..., _Value]) -> functools._lru_cache_wrapper[_Value]:
        cached = functools.lru_cache(maxsize)(function)
        alone: Any = one_at_a_time(cached)
        alone.cache_clear, alone.cache_info = cached.cache_clear, cached.cache_info
        return cast("functools._lru_cache_wrapper[_Value]", alone)

    return decorated


class locked_property(functools.cached_property[_Value]):  # noqa: N801  (used like a function)
    """`functools.cached_property` for `one_at_a_time`.

    That of Python 3.11 has a lock of its own, which is always taken after ours here.
    """

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> Any:
        """The value, computed at the first access."""
        with _LOCK:
            return super().__get__(instance, owner)


_lock = threading.Lock()
_users = 0
_limit: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS use one thread, until the last of the blocks that overlap in time has ended.

    The number of threads is one of the process: the first block saves it, the last restores it.
    """
    global _users, _limit  # noqa: PLW0603
    with _lock:
        if not _users:
            _limit = _controller().limit(limits=1, user_api="blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if not _users:
                _limit.restore_original_limits()


@cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
