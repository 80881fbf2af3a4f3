"""Hazards that a scenario names: functions and classes of the user, and where their code lies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from .._util.user_code import USER_ERRORS, failure_text
from .._util.user_folders import module_file
from .._util.user_modules import is_defined_in, load
from ..errors import HazardError
from .base import Hazard
from .custom import CustomHazard

ENTRY_POINTS = "casswarm.hazards"
"""Group of entry points by which installed packages offer hazards to scenario files."""


def origin(name: str, folder: Path) -> str | None:
    """What a scenario file in `folder` refers to by ``module:name``; None if there is no such code.

    Nothing is imported.
    """
    if file := module_file(name, folder):
        return str(file)
    if entry := _entry_point(name):
        package = entry.dist.name if entry.dist else "an unknown package"
        return f"the installed package {package} (entry point {entry.name!r})"
    return None


def user_hazard(
    kind: str | Callable[..., Any],
    folder: Path | None,
    radars: tuple[tuple[float, float], ...],
    parameters: Mapping[str, Any],
) -> Hazard:
    """Hazard of a user's function, or of a class derived from `Hazard`.

    `kind` is the function or class, or its name ``module:name``. With a folder, that of a scenario
    file, the module must lie in it and define what is named, or an installed package must offer
    it as an entry point; without, the module is imported as usual. A class is called with the
    radars and parameters.

    Raises
    ------
    HazardError
        The function or class cannot be imported or called, or fails.
    """
    rates = _named(kind, folder) if isinstance(kind, str) else kind
    if not (isinstance(rates, type) and issubclass(rates, Hazard)):
        return CustomHazard(rates, radars, parameters)
    try:
        return rates(**{"radars": radars} | dict(parameters))
    except HazardError:
        raise
    except USER_ERRORS as error:
        raise HazardError(f"{rates.__name__} cannot be made: {failure_text(error)}") from error


def _named(name: str, folder: Path | None) -> Callable[..., Any]:
    inside = folder is not None and module_file(name, folder) is not None
    entry = None if folder is None or inside else _entry_point(name)
    if folder is not None and not inside and entry is None:
        raise HazardError(missing(name, folder))
    try:
        found = entry.load() if entry else load(name, folder)
    except ImportError as error:
        raise HazardError(str(error)) from error
    except USER_ERRORS as error:  # of a package that offers it
        raise HazardError(f"{name!r} cannot be imported: {failure_text(error)}") from error
    if not callable(found):
        raise HazardError(f"{name!r} is not a function")
    is_hazard = isinstance(found, type) and issubclass(found, Hazard)
    if inside and not is_hazard and not is_defined_in(found, folder):  # type: ignore[arg-type]
        raise HazardError(
            f"{name!r} is not defined in the folder {folder}: write a function there that calls it"
        )
    return found  # type: ignore[no-any-return]


def missing(name: str, folder: Path) -> str:
    """Text for a name that refers to nothing."""
    file = folder.joinpath(*name.partition(":")[0].split(".")).with_suffix(".py")
    return f"there is no file {file}, and no installed package offers {name!r} ({ENTRY_POINTS})"


def _entry_point(name: str) -> EntryPoint | None:
    """The entry point of an installed package that refers to ``module:name``."""
    offered = entry_points(group=ENTRY_POINTS)
    return next((entry for entry in offered if entry.value == name), None)
