"""Results that are kept as they are made: a folder of cells that survives a kill.

A cell is written beside its place, synced to disk and moved into it, so it is there whole or not at
all; a checksum tells one that the disk spoilt. A folder knows the inputs it was made with. One
process at a time may use it: the operating system holds the lock and drops it when that process
dies, however it dies.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CheckpointError

SweepPoint = Mapping[str, NDArray[Any]]

_REMEDY = "give the same, or name another folder"
_NAMES = ("inputs.json", "finished")  # of files beside the cells
_MAX_REPORTED = 5  # differences that a message lists


class Checkpoint:
    """Cells in a folder, of a study with certain inputs. A context manager that holds the lock.

    Parameters
    ----------
    folder : Path
        Made where it does not exist.
    inputs : mapping
        All that decides the results, as JSON knows it; nested mappings are compared key by key.
    resume : bool
        Take up what is there. Otherwise a folder that holds an unfinished study is refused, and one
        that holds a finished study is begun anew.
    fresh : bool
        Begin anew whatever is there.

    Raises
    ------
    CheckpointError
        Another process works in the folder; it was made with other inputs (the difference is
        named); or it holds an unfinished study, and neither `resume` nor `fresh` was given.
    OSError
        The folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        inputs: Mapping[str, Any],
        *,
        resume: bool = False,
        fresh: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self._cells = self.folder / "cells"
        self._inputs_file = self._cells / "inputs.json"
        self._inputs = json.loads(json.dumps(inputs))
        self._resume, self._fresh = resume, fresh
        self._lock: io.TextIOWrapper | None = None

    def __enter__(self) -> Checkpoint:
        self._cells.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(self.folder / ".lock")
        try:
            self._begin()
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._release()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _begin(self) -> None:
        before = self._earlier_inputs()
        if before is not None and self._resume:
            self._require_equal(before)
            return
        if before is not None and not (self._fresh or (self._cells / "finished").exists()):
            raise CheckpointError(
                f"{self.folder} holds an unfinished study: continue it (--resume, resume=True), "
                "begin it anew (--fresh, fresh=True), or name another folder"
            )
        self._clear(before is not None)
        self._write(self._inputs_file, json.dumps(self._inputs, indent=1).encode())

    def _clear(self, known: bool) -> None:
        """Remove the cells of an earlier study; never what no study can have left."""
        foreign = [
            path
            for path in self._cells.iterdir()
            if path.is_dir() or not (path.suffix in (".npz", ".part") or path.name in _NAMES)
        ]
        cells = list(self._cells.glob("*.npz"))
        if foreign or (cells and not known and not self._fresh):
            what = (
                f"files of other origin, such as {foreign[0].name}"
                if foreign
                else (f"{len(cells)} cells whose inputs are lost")
            )
            raise CheckpointError(
                f"{self._cells} holds {what}: name another folder"
                + ("" if foreign else ", or begin anew (--fresh, fresh=True)")
            )
        for path in list(self._cells.iterdir()):
            path.unlink()

    def _earlier_inputs(self) -> Any:
        try:
            return json.loads(self._inputs_file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def _require_equal(self, before: Any) -> None:
        then, now = _flat(before), _flat(self._inputs)
        keys = sorted(key for key in then.keys() | now.keys() if then.get(key) != now.get(key))
        if keys:
            lines = [
                f"  {key}: {_shown(then.get(key))} there, {_shown(now.get(key))} now"
                for key in keys[:_MAX_REPORTED]
            ]
            more = [f"  and {len(keys) - _MAX_REPORTED} more"] if len(keys) > _MAX_REPORTED else []
            raise CheckpointError(
                "\n".join([f"{self.folder} was made with other inputs:", *lines, *more, _REMEDY])
            )

    def save(self, name: str, cell: SweepPoint) -> None:
        """Keep a cell under a name that is fit for a file."""
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **cell)
        data = content.getvalue()
        self._write(self._cells / f"{name}.npz", hashlib.sha256(data).digest() + data)

    def load(self, name: str) -> dict[str, NDArray[Any]] | None:
        """The cell of a name; None where there is none, or none that is whole."""
        try:
            content = (self._cells / f"{name}.npz").read_bytes()
        except OSError:
            return None
        digest, data = content[:32], content[32:]
        if hashlib.sha256(data).digest() != digest:
            return None
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return dict(arrays)

    def names(self) -> list[str]:
        """Names of the cells, sorted."""
        return sorted(path.stem for path in self._cells.glob("*.npz"))

    def finish(self) -> None:
        """Mark the study as finished: the folder may be begun anew without being asked for it."""
        self._write(self._cells / "finished", b"")

    def _write(self, path: Path, content: bytes) -> None:
        part = path.with_name(f".{path.name}.part")
        try:
            with part.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise


def _locked(path: Path) -> io.TextIOWrapper:
    """The open lock file, which names who holds it; closing it releases the lock."""
    file = path.open("a+", encoding="utf-8")
    try:
        _lock(file)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
            file.close()
            raise CheckpointError(
                f"{path.parent} cannot be locked against other processes ({error}): name a folder "
                "of another file system"
            ) from None
        file.seek(0)
        holder = file.read().strip() or "another process"
        file.close()
        raise CheckpointError(
            f"{path.parent} is in use by {holder}: wait for it, or name another folder"
        ) from None
    file.seek(0)
    file.truncate()
    file.write(f"process {os.getpid()} on {socket.gethostname()}")
    file.flush()
    return file


def _lock(file: io.TextIOWrapper) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        file.seek(1 << 20)  # a byte that nobody reads: a locked one cannot be read there
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    if not isinstance(value, dict):
        return {key: value}
    return {
        inner: leaf
        for name, item in value.items()
        for inner, leaf in _flat(item, f"{key}.{name}".lstrip(".")).items()
    }


def _shown(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def cell_name(text: str) -> str:
    """A name that is fit for a file, and differs for texts that differ."""
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "._") else "_" for c in text)
    return (
        plain if plain == text else f"{plain[:60]}_{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    )
