"""Kinds of hazards by name, and functions of the user's own: what a hazard table may name."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from ..errors import ScenarioError
from .validation import nearest, shown, wrong

ALPHAS = ("alpha_1", "alpha_2", "alpha_3")
BETAS = ("beta_1", "beta_2")
CONSTANTS = {"saturation": ALPHAS, "saturation+collision": ALPHAS + BETAS}
"""The built-in kinds, and the constants that each needs."""

KINDS = "'saturation', 'saturation+collision', or 'module:function'"
PARAMETERS = "a table of numbers, texts, true or false, or lists of these"

_NAME = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
_RESERVED = ("positions", "alive", "radars")  # arguments that a custom hazard gets anyway


def importable_name(function: Callable[..., Any]) -> str:
    """Name ``module:function`` under which `function` can be imported again.

    Raises
    ------
    ScenarioError
        It cannot, with the reason.
    """
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", None)
    if not isinstance(module, str) or not isinstance(name, str):
        raise ScenarioError(f"{shown(function)} has no name")
    if module == "__main__":
        raise ScenarioError(f"'{name}' is defined in a script or notebook, not in a module")
    if not _NAME.fullmatch(f"{module}:{name}"):
        raise ScenarioError(f"'{name}' is defined inside a function, or is a lambda")
    try:
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"'{module}:{name}' cannot be imported: {error}") from error
    if found is not function:
        raise ScenarioError(f"'{module}:{name}' is another object than the function given")
    return f"{module}:{name}"


def checked_kind(value: object) -> str | Callable[..., Any]:
    """Kind as a name, or as the function given if it has no name to be imported by."""
    if isinstance(value, str):
        if value in CONSTANTS or _NAME.fullmatch(value):
            return value
        meant = nearest(value, CONSTANTS)
        hint = f"; did you mean '{meant}'?" if meant else ""
        raise wrong([f"hazard.kind is {shown(value)}; it must be {KINDS}{hint}"])
    if callable(value):
        try:
            return importable_name(value)  # equal, then, to what a file says
        except ScenarioError:
            return value
    raise ValueError


def checked_parameters(value: object) -> dict[str, Any]:
    """Keyword arguments of a custom hazard, lists as tuples."""
    if not isinstance(value, Mapping):
        raise ValueError
    lines = [
        f"hazard.parameters.{key} is given to the function anyway; choose another name"
        for key in value
        if key in _RESERVED
    ]
    lines += [
        f"hazard.parameters.{key} is {shown(item)}; hazard.parameters must be {PARAMETERS}"
        for key, item in value.items()
        if not (isinstance(key, str) and _is_parameter(item))
    ]
    if lines:
        raise wrong(lines)
    return {key: _frozen(item) for key, item in value.items()}


def _is_parameter(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(_is_parameter(item) for item in value)
    if isinstance(value, int | float):
        return abs(value) < math.inf and (isinstance(value, float) or abs(value) < 2**63)
    return isinstance(value, str)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list | tuple) else value
