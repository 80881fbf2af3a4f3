"""Compilation of kernels where Numba's internals have changed: by its public functions only.

The functions are those of `casswarm.compiled.linking`, the numbers too; compiling takes twice as
long. Compiled code is kept by Numba's own cache, in a private folder for each state of the sources,
since that cache does not notice when a called kernel changes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba

from .folders import cache_folder, private_folder

LOG = logging.getLogger(__name__)


def entry_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from Python."""
    with _kept(stamp, "entries") as cache:
        return numba.njit(nogil=True, cache=cache, **_public(options))(function)


def linked_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from kernels."""
    wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    with _kept(stamp, "called") as cache:
        return numba.njit(cache=cache, **wrappers, **_public(options))(function)


def callback(
    function: Callable[..., Any], signature: str, options: dict[str, Any], stamp: bytes
) -> Any:
    """Compile a function to one that kernels take as argument."""
    with _kept(stamp, "callbacks") as cache:
        return numba.cfunc(signature, cache=cache, **_public(options))(function)


def _public(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if not name.startswith("_")}


@contextmanager
def _kept(stamp: bytes, kind: str) -> Iterator[bool]:
    """Let Numba's cache use a private folder, if there can be one; yield whether there is."""
    given = numba.config.CACHE_DIR
    try:
        base = private_folder(Path(given) if given else cache_folder())
        folder = private_folder(base / f"plain-{stamp.hex()[:16]}-{kind}")
    except OSError as error:
        LOG.warning("%s: compiled code is for this process only", error)
        yield False
        return
    numba.config.CACHE_DIR = str(folder)
    try:
        yield True
    finally:
        numba.config.CACHE_DIR = given
