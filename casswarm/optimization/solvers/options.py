"""Validation of a solver's options by the annotations of its fields.

A field that is annotated with one of the types below, with any ``Annotated[type, Allowed(...)]``
or with a ``Literal`` is checked when the solver is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import cache
from math import inf
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from ...errors import SolverError


@dataclass(frozen=True)
class Allowed:
    """Condition on an option's value, and its wording in messages."""

    condition: Callable[[Any], bool]
    text: str


Positive = Annotated[float, Allowed(lambda value: value > 0, "above zero")]
PositiveFinite = Annotated[float, Allowed(lambda value: 0 < value < inf, "above zero, finite")]
NonNegative = Annotated[float, Allowed(lambda value: value >= 0, "zero or above")]
PositiveInt = Annotated[int, Allowed(lambda value: value >= 1, "whole numbers from 1")]
Flag = Annotated[bool, Allowed(lambda value: isinstance(value, bool), "True or False")]
NonNegativeInt = Annotated[int, Allowed(lambda value: value >= 0, "zero or above")]


def check_options(solver: Any) -> None:
    """Raise SolverError, with what is allowed, for the first option that is out of range."""
    for option, allowed in _conditions(type(solver)):  # type: ignore[arg-type]
        value = getattr(solver, option)
        if not allowed.condition(value):
            message = f"{solver.name}: {option} = {value!r}; allowed: {allowed.text}"
            raise SolverError(message, solver=solver.name, option=option, value=value)


@cache
def _conditions(kind: Any) -> tuple[tuple[str, Allowed], ...]:
    """Every option that has a condition, with the condition."""
    try:
        hints = get_type_hints(kind, include_extras=True)
    except NameError:  # a user's class inside a function, whose annotations cannot be evaluated
        return ()
    names = [field.name for field in fields(kind)]
    return tuple((name, allowed) for name in names for allowed in _allowed(hints[name]))


def _allowed(hint: Any) -> Iterator[Allowed]:
    if get_origin(hint) is Annotated:
        yield from (entry for entry in hint.__metadata__ if isinstance(entry, Allowed))
    elif get_origin(hint) is Literal:
        yield Allowed(get_args(hint).__contains__, " or ".join(map(repr, get_args(hint))))
    elif NoneType in get_args(hint):
        for inner in _allowed(next(part for part in get_args(hint) if part is not NoneType)):
            yield Allowed(lambda v, c=inner.condition: v is None or c(v), f"{inner.text}, or None")  # type: ignore[misc]
