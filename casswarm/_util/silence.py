"""Silence for libraries that print by themselves, past every option that they have."""

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
    """Send what compiled code writes to standard output nowhere, for the whole process.

    It may write to the process's standard output or, as CasADi's plugins do, to Python's, which in
    notebooks is another one. Buffers are emptied before and after, so that nothing is lost and
    nothing comes late.
    """
    with _process_silence(), redirect_stdout(StringIO()):
        yield


@contextmanager
def _process_silence() -> Iterator[None]:
    """The same for the process's standard output alone; nothing where it has none."""
    try:
        kept = os.dup(_STDOUT)
    except OSError:
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    _flush()
    os.dup2(nowhere, _STDOUT)
    try:
        yield
    finally:
        _flush()
        os.dup2(kept, _STDOUT)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    with suppress(AttributeError, OSError, ValueError):  # sys.stdout may be None or closed
        sys.stdout.flush()
    with suppress(AttributeError, OSError, TypeError):  # no C library by that name on Windows
        ctypes.CDLL(None).fflush(None)
