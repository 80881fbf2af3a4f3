"""Files of compiled code with checksums, in folders that nobody else can write.

Numba unpickles what it finds, and runs it as machine code. Here a file counts only if it begins
with the hash of its content, the sources and the versions of Numba and llvmlite. Any other file is
removed, and its function is compiled again.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import llvmlite
import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    _CacheLocator,
    _SourceFileBackedLocatorMixin,
)
from numba.core.runtime import rtsys

from .folders import cache_folder, private_folder

LOG = logging.getLogger(__name__)

_HASH_SIZE = hashlib.sha256().digest_size


def compiled_files(
    function: Callable[..., Any], stamp: bytes, form: type[CompiledForm], kind: str = ""
) -> Any:
    """Cache of a function's compiled code; an empty one if no folder can be used.

    Parameters
    ----------
    function : callable
        Defined in a file.
    stamp : bytes
        Hash of the other sources that its compiled code depends on.
    form : type of CompiledForm
        How compiled code is written to files and read from them.
    kind : str
        What distinguishes the files of several kinds of compiled code of a function.
    """
    try:
        return _CheckedCache(function, stamp, form, kind)
    except OSError as error:
        _warn_once(f"{error}: compiled code is for this process only")
        return NullCache()


@lru_cache(maxsize=64)
def _warn_once(message: str) -> None:
    LOG.warning(message)


class _CheckedFile(IndexDataCacheFile):
    """Index and data files of a function, each of which begins with a hash."""

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        super().__init__(cache_path, filename_base, source_stamp)
        versions = numba.__version__, llvmlite.__version__
        self._salt = repr((versions, source_stamp)).encode()

    def load(self, key: Any) -> Any:
        """Compiled code, or None if there is none or it cannot be used."""
        try:
            return super().load(key)
        except Exception as error:  # any that unpickling raises, for example of classes that moved
            LOG.info("%s is compiled again: %r", self._index_path, error)
            _remove(self._index_path)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Save compiled code, if possible."""
        try:
            super().save(key, data)
        except OSError as error:
            LOG.warning("%s: compiled code is for this process only", error)

    def _load_index(self) -> Any:
        content = self._content(self._index_path)
        return {} if content is None else pickle.loads(content)

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, self._dump(overloads))

    def _load_data(self, name: str) -> Any:
        content = self._content(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)  # `load` then returns None
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _content(self, path: str) -> bytes | None:
        """Content of a file, None if there is none; a file that is damaged or stale is removed."""
        try:
            file = Path(path).read_bytes()
        except OSError:
            return None
        if file[:_HASH_SIZE] == self._hash(file[_HASH_SIZE:]):
            return file[_HASH_SIZE:]
        LOG.debug("%s is damaged or out of date", path)
        _remove(path)
        return None

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as file:
            file.write(self._hash(content) + content)

    def _hash(self, content: bytes) -> bytes:
        return hashlib.sha256(self._salt + content).digest()


class _Place(_SourceFileBackedLocatorMixin, _CacheLocator):
    """Folder of a function's files: the first that nobody else can write."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        self._folder = _folder(file, self.get_suitable_cache_subpath(file))

    def get_cache_path(self) -> str:
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        private_folder(self._folder)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Place:
        return cls(py_func, py_file)


def _folder(file: str, name: str) -> Path:
    """$NUMBA_CACHE_DIR, __pycache__ beside the file, or the user's cache folder.

    Raises
    ------
    OSError
        None of them can be used.
    """
    given = numba.config.CACHE_DIR
    if given:
        try:
            return private_folder(Path(given) / name)
        except OSError as error:
            _warn_once(f"NUMBA_CACHE_DIR is not used: {error}")
    try:
        return private_folder(Path(file).parent / "__pycache__")
    except OSError:
        private_folder(cache_folder())
        return private_folder(cache_folder() / name)


class CompiledForm(CompileResultCacheImpl):
    """Numba's form of compiled code in files, in folders of this module."""

    _locator_classes: ClassVar[list[type]] = [_Place]


class _CheckedCache(FunctionCache):
    def __init__(
        self, function: Callable[..., Any], stamp: bytes, form: type[CompiledForm], kind: str
    ) -> None:
        self._impl_class = form
        super().__init__(function)
        base, sources = kind + self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _CheckedFile(self._cache_path, base, (sources, stamp))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code of a signature, or None; without what Numba needs to compile, as it is."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def _remove(path: str) -> None:
    with suppress(OSError):
        Path(path).unlink()
