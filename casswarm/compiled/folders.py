"""Folders of compiled code, which only their user can write."""

from __future__ import annotations

import os
import stat
import tempfile
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path


def cache_folder() -> Path:
    """Folder of generated modules: $CASSWARM_CACHE, or the user's cache folder."""
    folder = os.environ.get("CASSWARM_CACHE")
    return Path(folder) if folder else user_cache_path("casswarm", appauthor=False)


@lru_cache(maxsize=64)
def private_folder(folder: Path) -> Path:
    """Make a folder, if it is not there, that only this user can open; return it.

    Raises
    ------
    OSError
        It cannot be made or written, or belongs to another user, or others may write there (which
        Windows is not asked).
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    if os.name == "posix":
        _require_private(folder)
    tempfile.TemporaryFile(dir=folder).close()  # whether it can be written
    return folder


def _require_private(folder: Path) -> None:
    status = folder.stat()
    advice = "set CASSWARM_CACHE to a folder of your own"
    if status.st_uid != os.geteuid():
        raise PermissionError(f"{folder} belongs to another user (uid {status.st_uid}): {advice}")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = f"{stat.S_IMODE(status.st_mode):o}"
        raise PermissionError(
            f"other users may write in {folder} (mode {mode}): chmod go-w, or {advice}"
        )
