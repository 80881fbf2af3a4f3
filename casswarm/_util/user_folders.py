"""Folders of the user as packages, found by their location.

`sys.path` is not changed, so a file of the user never takes the place of another module. A folder
is a package with a name of its own, from which its modules are imported; within them, ``from .
import helpers`` imports from the same folder. The name holds the folder, so that functions and
classes of these modules can be pickled and loaded by another process.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

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
