"""Temporary files and folders, which are removed even if their process is killed.

Their names state the computer and the process, so that the next process sees what is abandoned.
"""

from __future__ import annotations

import atexit
import os
import platform
import re
import shutil
import tempfile
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

_HOST = re.sub(r"[^A-Za-z0-9]+", "", platform.node())[:32]
_NAME = re.compile(rf"casswarm-{_HOST}-(\d+)-.*")


def temporary_folder() -> Path:
    """New folder that only this user can open; removed when this process ends."""
    remove_abandoned()
    folder = Path(tempfile.mkdtemp(prefix=_prefix()))
    atexit.register(_remove, folder)
    return folder


def temporary_file(suffix: str) -> Path:
    """New empty file that only this user can open; removed when this process ends."""
    remove_abandoned()
    handle, name = tempfile.mkstemp(prefix=_prefix(), suffix=suffix)
    os.close(handle)
    atexit.register(_remove, Path(name))
    return Path(name)


@lru_cache(maxsize=1)
def remove_abandoned() -> None:
    """Remove temporary files and folders of this user's dead processes; once per process.

    Links are neither followed nor removed. Does nothing on Windows, where a process cannot be asked
    for without the risk of ending it.
    """
    if os.name != "posix":
        return
    with suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            match = _NAME.fullmatch(entry.name)
            if match and not is_alive(int(match[1])) and _is_own(entry):
                _remove(Path(entry.path))


def _prefix() -> str:
    return f"casswarm-{_HOST}-{os.getpid()}-"


def is_alive(process: int) -> bool:
    """Whether a process of this computer runs; True where that cannot be asked without risk."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _is_own(entry: os.DirEntry[str]) -> bool:
    try:
        return not entry.is_symlink() and entry.stat(follow_symlinks=False).st_uid == os.geteuid()
    except OSError:
        return False


def _remove(path: Path) -> None:
    """Remove a file or a folder, as far as possible."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)
