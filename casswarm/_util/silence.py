"""Suppression of output that libraries print regardless of their options."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from typing import TextIO

_STDOUT = 1


@contextmanager
def silence() -> Iterator[None]:
    """Discard what compiled code writes to standard output, for the whole process.

    It may write to the process's standard output or, as CasADi's plugins do, to Python's, which is
    another one in notebooks. Buffers are flushed before and after, so that no other output is lost
    or delayed, and a Ctrl-C at any point does not leave standard output redirected.
    """
    redirection = _Redirection()
    try:
        redirection.begin()
        yield
    finally:
        try:
            redirection.end()
        finally:  # the first call is cut short if Ctrl-C occurs in it
            redirection.end()


class _Redirection:
    """Standard output of Python and of the process, redirected until `end`."""

    def __init__(self) -> None:
        self._python: list[TextIO] = []  # holds None where a program has no standard output
        self._process: list[int] = []

    def begin(self) -> None:
        """Redirect; the process's standard output only if there is one."""
        _flush()
        with suppress(OSError):
            self._process.append(os.dup(_STDOUT))
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, _STDOUT)
            os.close(null)
        self._python.append(sys.stdout)
        sys.stdout = StringIO()

    def end(self) -> None:
        """Undo `begin`, or what it did until it was interrupted; a second call does nothing."""
        if self._python:
            sys.stdout = self._python[0]
            self._python.clear()
        if self._process:
            _flush()
            os.dup2(self._process[0], _STDOUT)
            os.close(self._process.pop())


def _flush() -> None:
    with suppress(AttributeError, OSError, ValueError):  # sys.stdout may be None or closed
        sys.stdout.flush()
    with suppress(AttributeError, OSError, TypeError):  # no C library by that name on Windows
        ctypes.CDLL(None).fflush(None)
