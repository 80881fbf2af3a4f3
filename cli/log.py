"""Log messages of the library, and what solvers print, on standard error."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

from .._util.text import printable


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


@contextmanager
def shown_solvers(verbose: bool) -> Iterator[None]:
    """If verbose, print on standard error what solvers print on standard output."""
    if not verbose:
        yield
        return
    with redirect_stdout(sys.stderr):
        yield
