"""Progress of commands on standard error: what is done, how much of it, and for how long."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from .._util.progress import Bars
from .output import say

_LONG = 10.0  # seconds without a report after which the time is printed; then twice as many


class ProgressReport:
    """Progress on standard error: a `casswarm.Progress`.

    On a terminal, tasks with a known total have a bar; elsewhere, and for other tasks, a line says
    what is done. Where nothing is reported for long, a line says for how long.
    """

    def __init__(self) -> None:
        self._bars = Bars()
        self._started: set[str] = set()
        self._silent = ""  # the task whose time is printed, if it takes long
        self._since, self._next = time.monotonic(), _LONG
        self._ended = threading.Event()

    def __call__(self, task: str, done: float, total: float | None, /) -> None:
        """Report that `done` of `total` is done."""
        if total is None:
            if not done:
                say(task)
            self.watch(task)
        elif sys.stderr.isatty():
            self.watch("")
            self._bars(task, done, total)
        else:
            if task not in self._started and total > 1:
                say(f"{task}: {total:g}")
            self._started.add(task)
            self.watch("" if done >= total else task)

    def watch(self, task: str) -> None:
        """Note what is being done, for the case that it takes long; nothing if empty."""
        if task != self._silent:
            self._silent, self._since, self._next = task, time.monotonic(), _LONG

    @contextmanager
    def running(self) -> Iterator[ProgressReport]:
        """Report while a thread watches for tasks that take long."""
        thread = threading.Thread(target=self._wait, daemon=True)
        thread.start()
        with ExitStack() as stack:
            stack.callback(self._bars.close)
            stack.callback(thread.join)
            stack.callback(self._ended.set)
            yield self

    def _wait(self) -> None:
        while not self._ended.wait(0.2):
            task, seconds = self._silent, time.monotonic() - self._since
            if task and seconds >= self._next:
                say(f"{task}: {seconds:.0f} s so far")
                self._next = 2 * seconds


@contextmanager
def progress_report(quiet: bool) -> Iterator[ProgressReport | None]:
    """Report progress on standard error; None where nothing should be reported."""
    if quiet:
        yield None
        return
    with ProgressReport().running() as report:
        yield report
