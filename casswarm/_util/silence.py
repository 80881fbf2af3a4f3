"""Suppression of output that libraries print regardless of their options."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO

_STDOUT = 1


@contextmanager
def silence() -> Iterator[None]:
    """Discard what compiled code writes to standard output, for the whole process.

    It may write to the process's standard output or, as CasADi's plugins do, to Python's, which is
    another one in notebooks. Buffers are flushed before and after, so that no other output is lost
    or delayed.
    """
    with _process_silence(), redirect_stdout(StringIO()):
        yield


@contextmanager
def _process_silence() -> Iterator[None]:
    """Discard the process's standard output; does nothing if there is none."""
    try:
        saved = os.dup(_STDOUT)
    except OSError:
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    _flush()
    os.dup2(null, _STDOUT)
    try:
        yield
    finally:
        _flush()
        os.dup2(saved, _STDOUT)
        os.close(saved)
        os.close(null)


def _flush() -> None:
    with suppress(AttributeError, OSError, ValueError):  # sys.stdout may be None or closed
        sys.stdout.flush()
    with suppress(AttributeError, OSError, TypeError):  # no C library by that name on Windows
        ctypes.CDLL(None).fflush(None)
