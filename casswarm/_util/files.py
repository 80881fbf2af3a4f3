"""Files that are written completely or not at all, and files that are safe to read.

Temporary files and folders are removed even if their process is killed: their names state the
computer and the process, so that the next process sees what is abandoned.
"""

from __future__ import annotations

import atexit
import errno
import hashlib
import io
import json
import os
import platform
import re
import shutil
import stat
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

MAX_JSON, MAX_TABLE, MAX_ARRAYS = 200_000_000, 2_000_000_000, 2_000_000_000
"""Largest sizes in bytes of files that are read; of arrays, also when they are decompressed."""

DAMAGED = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)
"""Errors that damaged files raise when they are read or used."""

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
    """Return True if a process of this computer runs, or if it is not safe to ask."""
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


_PREFIX = ".part-"


def atomic_write(
    path: Path,
    content: str | bytes | Callable[[Path], object],
    before: Callable[[Path], object] | None = None,
) -> None:
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
    before : callable, optional
        Called with the complete temporary file, before it replaces `path`.

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
        if before is not None:
            before(part)
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def is_regular(path: Path) -> bool:
    """Return True if a path is a regular file, and not a link to one."""
    return path.is_file() and not path.is_symlink()


def digest(path: Path) -> str:
    """SHA-256 of a regular file, in hexadecimal digits; empty for links and all else."""
    if not is_regular(path):
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def set_aside(path: Path) -> Path:
    """Rename a file to NAME.bak, or NAME.2.bak and so on if that exists; return its new path."""
    names = (f"{path.name}{f'.{k}' if k > 1 else ''}.bak" for k in count(1))
    aside = next(p for p in map(path.with_name, names) if not os.path.lexists(p))
    path.rename(aside)
    return aside


def require_file(path: Path, max_bytes: int) -> None:
    """Raise OSError unless a path is a regular file of limited size: others may never end.

    Parameters
    ----------
    path : Path
    max_bytes : int

    Raises
    ------
    OSError
        No such file, a fifo, socket or device, or a file that is larger.
    IsADirectoryError
        A folder.
    """
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        reason = "it is a fifo, a socket or a device, not a regular file"
        raise OSError(errno.EINVAL, reason, str(path))
    if status.st_size > max_bytes:
        reason = f"it has {status.st_size:,} bytes, more than the limit of {max_bytes:,}"
        raise OSError(errno.EFBIG, reason, str(path))


def remove_partial(path: Path) -> None:
    """Remove what processes that were killed left of an `atomic_write` of this file."""
    for part in path.parent.glob(f"{_PREFIX}*"):
        process, _, name = part.name.removeprefix(_PREFIX).partition("-")
        if name == path.name and process.isdecimal() and not is_alive(int(process)):
            part.unlink(missing_ok=True)


def is_partial(path: Path) -> bool:
    """Return True if a file is the temporary file of an `atomic_write`."""
    return path.name.startswith(_PREFIX)


def read_json(path: Path) -> Any:
    """Content of a JSON file; one of `DAMAGED` if there is none, or another file."""
    require_file(path, MAX_JSON)
    return json.loads(path.read_text(encoding="utf-8"))


def read_table(path: Path) -> pd.DataFrame:
    """Table of a CSV file, its numbers equal to the last bit; only empty cells are missing."""
    import pandas as pd  # half a second

    require_file(path, MAX_TABLE)
    # from 3.1 on pandas always reads numbers to the last bit
    release = tuple(map(int, pd.__version__.split(".")[:2]))
    exact: dict[str, Any] = {} if release >= (3, 1) else {"float_precision": "round_trip"}
    table: pd.DataFrame = pd.read_csv(path, keep_default_na=False, na_values=[""], **exact)
    return table


def arrays_content(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Content of an .npz file of named arrays, which `read_arrays` reads."""
    import numpy as np

    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    return content.getvalue()


def read_arrays(source: Path | bytes) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz file or of its content; one of `DAMAGED` if they are not, or too large."""
    import numpy as np

    if isinstance(source, Path):
        require_file(source, MAX_ARRAYS)
    with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
        with zipfile.ZipFile(file) as parts:
            size = sum(part.file_size for part in parts.infolist())
        if size > MAX_ARRAYS:
            raise ValueError(f"{size:,} bytes when decompressed, more than {MAX_ARRAYS:,}")
        file.seek(0)
        with np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)


# --- run.json, the record of a results folder

RECORD = "run.json"


def read_record(folder: Path) -> Any:
    """Content of run.json in a folder; one of `files.DAMAGED` if there is none."""
    return read_json(folder / RECORD)


def own_record(folder: Path) -> Mapping[str, Any]:
    """Record that casswarm wrote in a folder; empty if there is none."""
    try:
        record = read_record(folder)
    except DAMAGED:
        return {}
    is_own = isinstance(record, dict) and "casswarm" in (record.get("versions") or ())
    return record if is_own else {}


def recorded_files(record: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of the files that a record lists, by name; empty where an older one has names only.

    Names with a folder, which no command writes, are left out.
    """
    files = record.get("files") or {}
    listed = files if isinstance(files, dict) else dict.fromkeys(map(str, files), "")
    return {name: str(value) for name, value in listed.items() if Path(name).name == name}


def listed(files: Mapping[str, str]) -> dict[str, str]:
    """Hashes of the files of a folder as its record lists them; its own is not known."""
    return dict(sorted({**files, RECORD: ""}.items()))


def time_stamp() -> str:
    """Date and time of now, in UTC."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def differences(first: Any, second: Any) -> dict[str, tuple[Any, Any]]:
    """Pairs of values that differ, by dotted key; None where one has no such key.

    Nested dictionaries are compared key by key.
    """
    a, b = _flat(first), _flat(second)
    return {key: (a.get(key), b.get(key)) for key in a | b if a.get(key) != b.get(key)}


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    if not isinstance(value, dict):
        return {key: value}
    return {
        inner: leaf
        for name, item in value.items()
        for inner, leaf in _flat(item, f"{key}.{name}" if key else f"{name}").items()
    }
