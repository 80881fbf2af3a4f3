"""Kernels that work on rows of arrays, on as many threads as there are cores."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np

from .kernels import announce

_PARTS = 4  # of the rows of a thread, since some take longer than others


def execute(
    kernel: Callable[..., None], rows: int, arguments: tuple[Any, ...], per_thread: int
) -> float:
    """Call ``kernel((first, end), *arguments)`` for all rows, on threads; return the seconds.

    A thread gets at least `per_thread` rows, since handing them over takes time; 0 counts as 1.
    """
    announce(kernel)
    started = time.perf_counter()

    threads = min(_cores(), rows // max(1, per_thread))
    if threads < 2:
        kernel((0, rows), *arguments)
    else:

        def work(first: int, end: int) -> None:
            kernel((first, end), *arguments)

        ends = np.linspace(0, rows, min(_PARTS * threads, rows) + 1).astype(int).tolist()
        list(_pool(os.getpid()).map(work, ends[:-1], ends[1:]))
    return time.perf_counter() - started


@lru_cache(maxsize=1)
def _cores() -> int:
    return os.cpu_count() or 1


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:  # noqa: ARG001  (threads do not survive a fork)
    return ThreadPoolExecutor(_cores(), thread_name_prefix="casswarm")
