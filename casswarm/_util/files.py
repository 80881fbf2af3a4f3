"""Files that are written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_PREFIX = ".part-"


def atomic_write(path: Path, content: str | bytes | Callable[[Path], object]) -> None:
    """Write a file so that it is there completely or not at all, even after a power failure.

    The content is written to a temporary file in the same folder, which is synced to disk and then
    renamed.

    Parameters
    ----------
    path : Path
        Its folder must exist. An existing file is replaced.
    content : str, bytes or callable
        Text (encoded as UTF-8), bytes, or a function that writes a file at the path it is called
        with; that path has the suffix of `path`, which may determine the format.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    part = path.with_name(f"{_PREFIX}{os.getpid()}-{path.name}")
    try:
        if callable(content):
            content(part)
        else:
            part.write_bytes(content.encode() if isinstance(content, str) else content)
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def is_partial(path: Path) -> bool:
    """Whether a file is the temporary file of an `atomic_write` that was killed."""
    return path.name.startswith(_PREFIX)
