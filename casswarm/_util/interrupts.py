"""Ctrl-C that is never lost, whatever compiled code makes of it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from types import FrameType
from typing import Any


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt after the block if Ctrl-C came in it, even if that was swallowed.

    CasADi looks for signals when it evaluates a function, and some plugins take the exception that
    it then meets for a failed evaluation, and go on; and where its expressions are built, Python is
    called from code that clears exceptions. Does nothing in threads, which get no signals,
    and leaves handlers of the user's own what they are.
    """
    previous_velocities = _replaceable_handler()
    if previous_velocities is None:
        yield
        return
    came = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal came
        try:
            previous_velocities(number, frame)
        except KeyboardInterrupt:
            came = True
            raise

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_velocities)
        if came:
            raise KeyboardInterrupt


def begin_child() -> None:
    """Leave Ctrl-C to the parent of this process, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def deferred() -> Iterator[None]:
    """Hold Ctrl-C back until after the block; processes that are born in it never see one.

    So a child is either not there or complete, and says nothing on a terminal where Ctrl-C goes to
    parent and child alike.
    """
    with _heard_later(), blocked():
        yield


@contextmanager
def _heard_later() -> Iterator[None]:
    previous_velocities = _replaceable_handler()
    if previous_velocities is None:
        yield
        return
    came = False

    def handler(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_velocities)
        if came:
            previous_velocities(signal.SIGINT, None)


def _replaceable_handler() -> Callable[[int, FrameType | None], Any] | None:
    """The handler of SIGINT, where this is the thread that may replace it and there is one."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        return None
    return handler


@contextmanager
def blocked() -> Iterator[None]:
    """SIGINT kept from this thread and its children; nothing on Windows, which has no masks."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running  # there is none on Windows

    ensure_running()  # now, since it unblocks the signal when it starts
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
