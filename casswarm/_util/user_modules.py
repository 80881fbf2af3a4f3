"""Modules of the user: importing what they define, and where it was defined."""

from __future__ import annotations

import hashlib
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from .user_code import USER_ERRORS, failure_text
from .user_folders import module_file, package_name


def load(name: str, folder: Path | None) -> Any:
    """Object that ``module:name`` names, of a module in `folder`, or of an installed one if None.

    Raises
    ------
    ImportError
        The module cannot be imported, by whatever it raises, or has no such name.
    """
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute:
        raise ImportError(f"{name!r} is not of the form 'module:function'")
    package = "" if folder is None else package_name(folder)
    try:
        found: Any = import_module(f"{package}.{module_name}".lstrip("."))
    except USER_ERRORS as error:
        reason = _reason(error, folder)
        if folder is not None:
            reason = reason.replace(f"{package}.", "").replace(package, str(folder))
        raise ImportError(
            f"cannot import the module {module_name!r} of {name!r}: {reason}"
        ) from error
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise ImportError(f"the module {module_name!r} has no function {attribute!r}")
        found = getattr(found, part)
    return found


def _reason(error: BaseException, folder: Path | None) -> str:
    """The error, and what to write where a module of the same folder was meant."""
    reason, module = failure_text(error), getattr(error, "name", None) or ""
    if isinstance(error, ModuleNotFoundError) and folder and module_file(module, folder):
        return f"{reason}; write `from . import {module}` for the module beside it"
    return reason


def is_defined_in(found: Any, folder: Path) -> bool:
    """Whether a function or class is defined in a module that was loaded from a folder."""
    module = getattr(found, "__module__", None)
    origin = getattr(sys.modules.get(module or ""), "__file__", None)
    return origin is not None and Path(origin).is_relative_to(folder.resolve())


def code_hash(found: Any) -> str:
    """SHA-256 of the file that defines a function or class; empty for casswarm's own.

    Of a function or class without a file, as in a notebook, that of its text if it is known.
    """
    import inspect  # slow, and rarely needed

    module = getattr(found, "__module__", None) or ""
    if module.partition(".")[0] == __name__.partition(".")[0]:
        return ""
    origin = getattr(sys.modules.get(module), "__file__", None)
    try:
        text = Path(origin).read_text(encoding="utf-8") if origin else inspect.getsource(found)
    except (OSError, TypeError, ValueError):
        return ""
    return hashlib.sha256(text.encode()).hexdigest()
