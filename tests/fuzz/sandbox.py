"""One case in a process of its own: forked, limited in time and memory, and read afterwards."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

TIME_LIMIT = 60.0  # seconds of processor time of a case
PATIENCE = 300.0  # seconds of a case, which other work on the machine may slow down
MEMORY_LIMIT = 2 * 2**30  # bytes of a case, above the process that it is forked from
CRASHED = 99  # exit code of an exception that no command and no loader may end with

_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
_UNIT = 1 if sys.platform == "darwin" else 1024  # of a peak that the system reports
_OUTPUT = "output"  # file that takes what the case prints


class Outcome(NamedTuple):
    """How a case ended: its exit code (minus the signal, if one ended it), seconds of processor
    time, the peak of its memory in bytes, what it printed, and why it was stopped.
    """

    code: int
    seconds: float
    peak: int
    output: str
    stopped: str = ""


def run(
    case: Callable[[], int],
    folder: Path,
    idle: int = 0,
    time_limit: float = TIME_LIMIT,
    patience: float = PATIENCE,
) -> Outcome:
    """Run a case in a folder and in a process group of its own.

    `idle` is the peak of a case that does nothing, above which the limit of memory counts.
    """
    sys.stdout.flush()
    begun = time.monotonic()
    child = os.fork()
    if child == 0:
        _run_in_child(case, folder)
    stopped = ""
    while True:
        finished, status, usage = os.wait4(child, os.WNOHANG)
        if finished:
            break
        elapsed = time.monotonic() - begun
        if not stopped:
            if _processor_time(child) > time_limit or elapsed > patience:
                stopped = f"hangs: {_processor_time(child):.0f} s, {elapsed:.0f} s on the clock"
            elif _resident(child) - idle > MEMORY_LIMIT:
                stopped = "more than 2 GB"
            if stopped:
                os.killpg(child, signal.SIGKILL)
        time.sleep(min(0.05, 0.001 + elapsed / 20))
    peak = usage.ru_maxrss * _UNIT
    code, seconds = os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime
    output = (folder / _OUTPUT).read_text(encoding="utf-8", errors="surrogateescape")
    if peak - idle > MEMORY_LIMIT:
        stopped = stopped or "more than 2 GB"
    return Outcome(code, seconds, peak, output, stopped)


def _run_in_child(case: Callable[[], int], folder: Path) -> None:
    code = CRASHED
    try:
        os.setsid()
        os.chdir(folder)
        target = os.open(_OUTPUT, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(target, stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        code = case()
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _resident(process: int) -> int:
    """Bytes of memory that a process has now; 0 where the system does not tell."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * _PAGE
    except (OSError, IndexError):
        return 0


def _processor_time(process: int) -> float:
    """Seconds of processor time of a process and its ended children; 0 where that is unknown."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
