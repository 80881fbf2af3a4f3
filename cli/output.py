"""Output of commands: results, and on standard error progress and log messages."""

from __future__ import annotations

import logging
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.documents import json_text
from .._util.progress import Bars
from .._util.text import printable, wrapped
from .options import FigureOptions, OutputOptions

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


def say(text: str, quiet: bool = False) -> None:
    """Print a line on standard error."""
    if not quiet:
        click.echo(printable(text), err=True)


@contextmanager
def said_warnings() -> Iterator[None]:
    """Print casswarm's warnings as lines on standard error, each once."""
    shown, said = warnings.showwarning, set[str]()

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        text = str(message)
        if not issubclass(category, csw.CasswarmWarning):
            shown(message, category, *place, **more)
        elif text not in said:
            said.add(text)
            say(f"warning: {text}")

    with warnings.catch_warnings():
        warnings.simplefilter("always", csw.CasswarmWarning)
        warnings.showwarning = show
        yield


def open_folder(
    command: str, scenario: csw.Scenario | None, out: Path | None, figures: FigureOptions
) -> ResultsFolder:
    """Folder for the results of a command, with figures as the options ask for them."""
    from ..results.drawing import FigureFormat
    from ..results.folder import ResultsFolder

    figure_format = FigureFormat(figures.format, figures.width, figures.dpi)
    return ResultsFolder.create(command, scenario, out, figure_format)


def print_result(folder: ResultsFolder, text: str, output: OutputOptions) -> None:
    """Print the result, as text or as JSON, and which files were written."""
    click.echo(json_text(folder.record) if output.as_json else wrapped(text))
    say(folder.summary(), output.quiet)


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


class _Printable(logging.Formatter):
    """Messages without characters that a terminal would obey."""

    def format(self, record: logging.LogRecord) -> str:
        """Text of a record."""
        return printable(super().format(record))


def show_log(verbose: bool = False) -> None:
    """Print log messages on standard error; if verbose, all of them, with their loggers' names."""
    log = logging.getLogger("casswarm")
    log.setLevel(logging.DEBUG if verbose else logging.INFO)
    if not log.handlers:
        log.addHandler(logging.StreamHandler())  # standard error
    for handler in log.handlers:
        handler.setFormatter(_Printable("%(name)s: %(message)s" if verbose else None))
