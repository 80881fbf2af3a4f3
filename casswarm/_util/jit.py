"""Generated Python modules, compiled by Numba once and kept on disk.

Numba keeps what it compiles beside the module's file, so a generated module must be a file that
stays: it is written to the user's cache folder under the hash of its text.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from platformdirs import user_cache_path

from .files import atomic_write

LOG = logging.getLogger(__name__)

_HEADER = """\
import math
import numba
import numpy as np
from math import inf, nan

compiled = numba.njit(cache=True, nogil=True, error_model="numpy")

"""


def cache_folder() -> Path:
    """Where generated modules are kept: $CASSWARM_CACHE, or the user's cache folder."""
    given = os.environ.get("CASSWARM_CACHE")
    return Path(given) if given else user_cache_path("casswarm", appauthor=False)


@lru_cache(maxsize=64)
def compiled_module(*parts: str) -> ModuleType:
    """Module of the joined texts, in which ``@compiled`` functions are compiled when first called.

    Parameters
    ----------
    parts : str
        Python texts, in order; they share one namespace with `math`, `np` and `compiled`.
    """
    text = _HEADER + "\n\n".join(parts)
    name = f"casswarm_{hashlib.sha256(text.encode()).hexdigest()[:24]}"
    path = _kept(name, text)
    if not any(path.parent.glob(f"__pycache__/{name}.*.nbi")):  # Numba's index of what is compiled
        LOG.warning("compiling, once and for some seconds; it is kept in %s", path.parent)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where Numba looks for what it loads from disk
    spec.loader.exec_module(module)
    return module


def _kept(name: str, text: str) -> Path:
    """Write the text where it stays; where that cannot be, for this process only."""
    try:
        return _written(cache_folder(), name, text)
    except OSError as error:
        LOG.warning("%s: what is compiled now is for this process only", error)
        return _written(Path(tempfile.mkdtemp(prefix="casswarm-")), name, text)


def _written(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name}.py"
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return path
    folder.mkdir(parents=True, exist_ok=True)
    atomic_write(path, text)
    return path
