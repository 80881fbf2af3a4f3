"""Code of users: its folders, its modules, and calls with failures as one line.

`sys.path` is not changed, so a file of the user never takes the place of another module. A folder
is a package with a name of its own, from which its modules are imported; within them, ``from .
import helpers`` imports from the same folder. The name holds the folder, so that functions and
classes of these modules can be pickled and loaded by another process.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

USER_ERRORS = (Exception, SystemExit)
"""What code of users may raise: everything but Ctrl-C; `sys.exit` is an error like others."""

_OWN = str(Path(__file__).parents[1])


def failure_text(error: BaseException) -> str:
    """Exception as one line: its type, its message, and the user's own line that led to it."""
    kind, message = type(error).__name__, " ".join(str(error).split())
    if isinstance(error, SystemExit):
        kind, message = "SystemExit", f"sys.exit({'' if error.code is None else repr(error.code)})"
    text = f"{kind}: {message}" if message else kind
    where = _user_line(error)
    return f"{text} ({where})" if where else text


def _user_line(error: BaseException) -> str:
    """File and line of the innermost frame outside casswarm and installed packages."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{_shown(error.filename)}:{error.lineno}"
    import traceback  # slow, and rarely needed

    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _is_users(frame.filename)]
    return "".join(f"{_shown(frame.filename)}:{frame.lineno}" for frame in own[-1:])


def _is_users(file: str) -> bool:
    import sysconfig

    standard = map(sysconfig.get_path, ("stdlib", "platstdlib"))
    installed = {"site-packages", "dist-packages"} & set(Path(file).parts)
    return not installed and not file.startswith((_OWN, "<", *standard))


def _shown(file: str) -> str:
    """Path of a file, from the current folder if it is in it."""
    path, here = Path(file), Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


_PREFIX = "casswarm_user_"


def package_name(folder: Path) -> str:
    """Name of the package of a folder."""
    return f"{_PREFIX}{str(folder.resolve()).encode().hex()}"


class _Source(SourceFileLoader):
    """Loader of the text of a file, and never of compiled code that lies beside it."""

    def get_code(self, fullname: str) -> Any:
        """Code of the file's text."""
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _Folders:
    """Finder of the packages of folders, and of the modules in them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Specification of a module, or None if it is not of a folder of the user."""
        del target
        if not fullname.startswith(_PREFIX):
            return None
        if path is None:
            return _package(fullname, bytes.fromhex(fullname.removeprefix(_PREFIX)).decode())
        found = Path(next(iter(path))) / fullname.rpartition(".")[2]
        if file := _file(found):
            folders = [str(found)] if file.parent == found else None
            return spec_from_file_location(
                fullname,
                file,
                loader=_Source(fullname, str(file)),
                submodule_search_locations=folders,
            )
        if found.is_dir():
            return _package(fullname, str(found))
        raise ModuleNotFoundError(f"no file {found}.py", name=fullname)


def install() -> None:
    """Let Python find these packages, also when it unpickles objects of them."""
    if not any(isinstance(finder, _Folders) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Folders())


def _package(name: str, folder: str) -> ModuleSpec:
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = [folder]
    return spec


def _file(path: Path) -> Path | None:
    candidates = path.with_name(f"{path.name}.py"), path / "__init__.py"
    return next((file for file in candidates if file.is_file()), None)


def module_file(name: str, folder: Path) -> Path | None:
    """File of the module of ``module:name`` in a folder; None if there is none."""
    return _file(folder.joinpath(*name.partition(":")[0].split(".")))


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
    """Return True if a function or class is defined in a module that was loaded from a folder."""
    module = getattr(found, "__module__", None)
    origin = getattr(sys.modules.get(module or ""), "__file__", None)
    return origin is not None and Path(origin).is_relative_to(folder.resolve())


def code_hash(found: Any) -> str:
    """SHA-256 of the file that defines a function or class; empty for casswarm's own.

    Of a function or class without a file, as in a notebook, that of its text if it is known.
    """
    import hashlib
    import inspect

    module = getattr(found, "__module__", None) or ""
    if module.partition(".")[0] == __name__.partition(".")[0]:
        return ""
    origin = getattr(sys.modules.get(module), "__file__", None)
    try:
        text = Path(origin).read_text(encoding="utf-8") if origin else inspect.getsource(found)
    except (OSError, TypeError, ValueError):
        return ""
    return hashlib.sha256(text.encode()).hexdigest()
