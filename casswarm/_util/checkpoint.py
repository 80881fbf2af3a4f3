"""Crash-safe checkpoints of a study: records in a folder that survive a kill.

A record is written atomically, so it is there completely or not at all; a checksum reveals one that
was damaged on disk. A folder knows the inputs of its study. One process at a time may use it: the
operating system holds the lock and drops it when that process dies.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from ..errors import CheckpointError
from .files import (
    DAMAGED,
    arrays_content,
    atomic_write,
    differences,
    is_partial,
    is_regular,
    read_arrays,
    read_json,
)
from .parts import PartFolder, PartSaved
from .text import shortened, shown

IfExists = Literal["error", "resume", "overwrite"]
"""What to do with a folder that holds a study: see `Checkpoint`."""

_FOLDER = "checkpoint"  # of the records, in that of the results
_LOCK_FILES = ("lock", "lock-holder")
_ADVICE = "use the same inputs, or choose another folder"
_MAGIC = b"casswarm record\n"  # then follow the hash of the inputs, that of the rest, the arrays
_MAX_HOLDER = 200  # characters of the name of another process
_MAX_REPORTED = 5  # differences that a message lists


class Checkpoint:
    """Records of a study in a folder. A context manager that holds the folder's lock.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.
    inputs : mapping
        All that determines the results, as JSON values; nested mappings are compared key by key.
    if_exists : {"error", "resume", "overwrite"}
        With a folder that holds an unfinished study: refuse it, continue it, or start over. A
        finished study is continued if "resume", else replaced; one of which nothing was saved is
        always replaced.

    Raises
    ------
    CheckpointError
        Another process uses the folder, it belongs to other inputs (the difference is named), or it
        holds an unfinished study and `if_exists` is "error".
    ValueError
        Another value of `if_exists`.
    OSError
        The folder cannot be written.
    """

    def __init__(
        self, folder: Path, inputs: Mapping[str, Any], if_exists: IfExists = "error"
    ) -> None:
        if if_exists not in ("error", "resume", "overwrite"):
            raise ValueError(f"if_exists = {shown(if_exists)}; allowed: error, resume, overwrite")
        self.folder = Path(folder)
        self._records = self.folder / _FOLDER
        self._inputs_file = self._records / "inputs.json"
        self._inputs = json.loads(json.dumps(inputs))
        self._header = _MAGIC + _sha256(json.dumps(self._inputs, sort_keys=True).encode())
        self._if_exists = if_exists
        self._lock = FileLock(self._records / "lock", timeout=0)

    def __enter__(self) -> Checkpoint:
        self._refuse_links()
        self._records.mkdir(parents=True, exist_ok=True)
        self._acquire()
        try:
            self._begin()
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._lock.release()

    def _error(self, message: str, **values: Any) -> CheckpointError:
        return CheckpointError(message, folder=self.folder, **values)

    def _refuse_links(self) -> None:
        """Raise CheckpointError where a link or a device would be written through."""
        for path, expected in (
            (self._records, Path.is_dir),
            (self._records / "lock", Path.is_file),
        ):
            if os.path.lexists(path) and (path.is_symlink() or not expected(path)):
                raise self._error(f"{path} is not of casswarm: remove it, or choose another folder")

    def _acquire(self) -> None:
        try:
            self._lock.acquire()
        except Timeout:
            name = _holder(self._records / "lock-holder")
            raise self._error(
                f"{self.folder} is in use by {name}: wait for it, or choose another folder"
            ) from None
        except PermissionError:
            raise
        except OSError as error:
            raise self._error(
                f"{self.folder} cannot be locked against other processes ({error}): choose a "
                "folder on another file system"
            ) from None
        holder = f"process {os.getpid()} on {socket.gethostname()}"
        atomic_write(self._records / "lock-holder", holder)

    def _begin(self) -> None:
        try:
            earlier = read_json(self._inputs_file)
        except DAMAGED:
            earlier = None
        worth_keeping = earlier is not None and bool(self.names())
        if worth_keeping and self._if_exists == "resume":
            self._require_equal(earlier)
            for path in filter(is_partial, list(self._records.iterdir())):
                path.unlink()
            return
        unfinished = worth_keeping and not (self._records / "finished").exists()
        if unfinished and self._if_exists == "error":
            raise self._error(
                f"{self.folder} holds an unfinished study: continue it (if_exists='resume', on the "
                "command line --resume), start over (if_exists='overwrite', --overwrite), or "
                "choose another folder"
            )
        self._clear(earlier is not None)
        atomic_write(self._inputs_file, json.dumps(self._inputs, indent=1))

    def _clear(self, known: bool) -> None:
        """Remove the records of an earlier study, but no file that cannot be of a study."""
        paths = [path for path in self._records.iterdir() if path.name not in _LOCK_FILES]
        records = [path for path in paths if path.suffix == ".npz"]
        foreign = [path for path in paths if not self._is_of_study(path)]
        if foreign:
            raise self._error(
                f"{self._records} holds files of other origin, such as {foreign[0].name}: choose "
                "another folder"
            )
        if records and not known and self._if_exists != "overwrite":
            raise self._error(
                f"{self._records} holds {len(records)} records whose inputs are lost: choose "
                "another folder, or start over (if_exists='overwrite', --overwrite)"
            )
        for path in paths:
            path.unlink()

    @staticmethod
    def _is_of_study(path: Path) -> bool:
        """Return True if a study wrote the file: it is a whole record, or known by its name."""
        if not is_regular(path):
            return False
        if path.name == "finished":
            return not path.stat().st_size
        return (
            path.name == "inputs.json" or is_partial(path) or _arrays_of(path, _MAGIC) is not None
        )

    def _require_equal(self, earlier: Any) -> None:
        different = differences(earlier, self._inputs)
        if not different:
            return
        keys = sorted(different, key=lambda key: (key.count("."), key))  # settings, then details
        lines = [
            f"  {key}: {_shortened(then)} there, {_shortened(now)} now"
            for key in keys[:_MAX_REPORTED]
            for then, now in [different[key]]
        ]
        if len(keys) > _MAX_REPORTED:
            lines.append(f"  and {len(keys) - _MAX_REPORTED} more")
        title = f"{self.folder} belongs to other inputs:"
        raise self._error("\n".join([title, *lines, _ADVICE]), keys=keys)

    def save(self, name: str, record: Mapping[str, NDArray[Any]]) -> None:
        """Write a record of arrays under a name that can be that of a file."""
        self._write(name, arrays_content(record))

    def _write(self, name: str, data: bytes) -> None:
        atomic_write(self._records / f"{name}.npz", self._header + _digest(name, data) + data)

    def load(self, name: str) -> dict[str, NDArray[Any]] | None:
        """Read a record; None if there is none, or if it is damaged or of another study."""
        data = _arrays_of(self._records / f"{name}.npz", self._header)
        try:
            return None if data is None else read_arrays(data)
        except DAMAGED:
            return None

    def save_json(self, name: str, value: Any) -> None:
        """Write a record of JSON values; NaN and infinity are kept."""
        self.save(name, {"json": np.array(json.dumps(value))})

    def load_json(self, name: str) -> Any:
        """Read a record of JSON values; None where `load` is."""
        try:
            return json.loads(str((self.load(name) or {})["json"]))
        except (KeyError, ValueError, RecursionError):
            return None

    def names(self) -> list[str]:
        """Names of the records, sorted."""
        return sorted(p.stem for p in self._records.glob("*.npz") if not is_partial(p))

    def adopt(self, folder: Path) -> None:
        """Copy the records of a part that this study lacks, or of which its own are damaged.

        Raises
        ------
        CheckpointError
            They are of other inputs.
        """
        other = Checkpoint(folder, self._inputs)
        try:
            other._require_equal(read_json(other._inputs_file))
        except DAMAGED as error:
            raise other._error(f"{folder} holds no part of a study: {error}") from None
        for name in other.names():
            data = _arrays_of(other._records / f"{name}.npz", self._header)
            if data is not None and self.load(name) is None:
                self._write(name, data)

    def finish(self) -> None:
        """Mark the study as finished: it may then be replaced without being asked for it."""
        atomic_write(self._records / "finished", b"")


@contextmanager
def opened(
    folder: str | Path | PartFolder | None,
    inputs: Callable[[], Mapping[str, Any]],
    if_exists: IfExists,
) -> Iterator[Checkpoint | None]:
    """Checkpoint of a study, which is finished if the block succeeds; None without a folder.

    Raises
    ------
    PartSaved
        The folder is that of a part, and the block succeeded.
    """
    if folder is None:
        yield None
        return
    path = folder.path if isinstance(folder, PartFolder) else Path(folder)
    with Checkpoint(path, inputs(), if_exists) as store:
        yield store
        if isinstance(folder, PartFolder):
            raise PartSaved(folder.part)
        store.finish()


def joined(parts: Sequence[Path], folder: Path) -> None:
    """Copy the records of a study's parts into a folder, where the study can then be resumed.

    Raises
    ------
    CheckpointError
        A folder has no records, or those of other inputs than the first one.
    """
    inputs_file = parts[0] / _FOLDER / "inputs.json"
    try:
        inputs = read_json(inputs_file)
    except DAMAGED as error:
        message = f"{parts[0]} holds no part of a study: {error}"
        raise CheckpointError(message, folder=parts[0]) from None
    with Checkpoint(folder, inputs, "resume") as store:
        for part in parts:
            store.adopt(part)


def has_records(folder: Path, since: float = 0.0) -> bool:
    """Return True if a folder holds records that were saved since a time of `time.time`."""
    records = (path for path in (folder / _FOLDER).glob("*.npz") if not is_partial(path))
    return any(path.stat().st_mtime >= since for path in records)


def _holder(path: Path) -> str:
    """Name of the process that holds the lock, as it wrote it."""
    if not is_regular(path):
        return "another process"
    text = path.read_text(encoding="utf-8", errors="replace")[:_MAX_HOLDER]
    return text if text.isprintable() and text else "another process"


def _sha256(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def _digest(name: str, data: bytes) -> bytes:
    """Hash of a record's arrays under its name: a copy under another name does not count."""
    return _sha256(name.encode() + b"\n" + data)


def _arrays_of(path: Path, header: bytes) -> bytes | None:
    """Arrays of a record that begins with `header`; None for any other file, and for links."""
    if not is_regular(path):
        return None
    content = path.read_bytes()
    start = len(_MAGIC) + 32
    digest, data = content[start : start + 32], content[start + 32 :]
    return data if content.startswith(header) and _digest(path.stem, data) == digest else None


def _shortened(value: Any) -> str:
    return "nothing" if value is None else shortened(json.dumps(value))


def file_name(text: str) -> str:
    """Text that can be the name of a file and differs for texts that differ."""
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "._") else "_" for c in text)
    return (
        plain if plain == text else f"{plain[:60]}_{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    )
