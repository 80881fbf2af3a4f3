"""Signals: Ctrl-C around compiled code and child processes, and a limit of time."""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def deferred() -> Iterator[None]:
    """Defer Ctrl-C until after the block, and hide it from processes that are started in it.

    A child is then either complete or not started, and prints nothing on a terminal that sends
    Ctrl-C to parent and child.
    """
    with interruptible(defer=True), blocked():
        yield


@contextmanager
def interruptible(*, defer: bool = False) -> Iterator[None]:
    """Raise KeyboardInterrupt after the block if Ctrl-C occurred in it, even if it was suppressed.

    CasADi checks for signals when it evaluates a function, and some plugins treat the resulting
    exception as a failed evaluation and continue; while expressions are built, Python is called
    from code that clears exceptions. A user's handler of SIGINT is called, with `defer` only after
    the block, and restored. Does nothing in threads, which receive no signals.
    """
    previous = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(previous):
        yield
        return
    interrupted = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if defer:
            interrupted = True
            return
        try:
            previous(number, frame)
        except KeyboardInterrupt:
            interrupted = True
            raise

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
        if interrupted and defer:
            previous(signal.SIGINT, None)
        elif interrupted and not isinstance(sys.exception(), GeneratorExit):  # raised on entry
            raise KeyboardInterrupt


def restore_sigint_handler() -> None:
    """Give SIGINT back to Python's handler, where compiled code has installed one of its own."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is threading.main_thread() and handler is not None:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def blocked() -> Iterator[None]:
    """Block SIGINT in this thread and its children; does nothing on Windows."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running  # not on Windows

    ensure_running()  # first, since its start unblocks the signal
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


class _Expired(BaseException):
    """The alarm: no `except Exception` of the interrupted code stops it."""


@contextmanager
def limited_time(seconds: float) -> Iterator[None]:
    """Raise TimeoutError if the block takes longer than a number of seconds.

    The block is interrupted on the main thread of a process, by a signal, wherever it executes
    Python code; compiled code ends first. In other threads, such as those of a Dask worker, and on
    Windows nothing can interrupt it: the error is raised when it has ended.
    """
    started = time.monotonic()
    main = threading.current_thread() is threading.main_thread()
    if main and seconds < math.inf and hasattr(signal, "setitimer"):
        with _alarm(seconds):
            yield
    else:
        yield
    if time.monotonic() - started > seconds:
        raise TimeoutError


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Interrupt the block after some seconds, by TimeoutError; an earlier timer goes on after."""
    active, started = True, time.monotonic()

    def expire(*_: object) -> None:
        if active:
            raise _Expired

    handler = signal.signal(signal.SIGALRM, expire)
    earlier, interval = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except _Expired:
        raise TimeoutError from None
    finally:
        active = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        if earlier:
            left = max(earlier - (time.monotonic() - started), 1e-6)
            signal.setitimer(signal.ITIMER_REAL, left, interval)
