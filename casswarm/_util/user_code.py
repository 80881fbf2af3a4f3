"""Calls of code that users write: their failures as one line, and a limit of their time."""

from __future__ import annotations

import math
import signal
import sysconfig
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

USER_ERRORS = (Exception, SystemExit)
"""What code of users may raise: everything but Ctrl-C; `sys.exit` is an error like others."""

_OWN = str(Path(__file__).parents[1])
_STANDARD = tuple(map(sysconfig.get_path, ("stdlib", "platstdlib")))


def failure_text(error: BaseException) -> str:
    """Exception as one line: its type, its message, and the user's own line that led to it."""
    kind, message = type(error).__name__, " ".join(str(error).split())
    if isinstance(error, SystemExit):
        kind, message = "SystemExit", f"sys.exit({'' if error.code is None else repr(error.code)})"
    text = f"{kind}: {message}" if message else kind
    where = _user_line(error)
    return f"{text} ({where})" if where else text


def _user_line(error: BaseException) -> str:
    """File and line of the innermost frame outside casswarm and installed packages."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{_shown(error.filename)}:{error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _is_users(frame.filename)]
    return "".join(f"{_shown(frame.filename)}:{frame.lineno}" for frame in own[-1:])


def _is_users(file: str) -> bool:
    installed = {"site-packages", "dist-packages"} & set(Path(file).parts)
    return not installed and not file.startswith((_OWN, "<", *_STANDARD))


def _shown(file: str) -> str:
    """Path of a file, from the current folder if it is in it."""
    path, here = Path(file), Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


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
