"""Validation of scenario files: types of values with their limits, and errors in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from .._util.text import closest, shortened
from ..errors import ScenarioError

SMALLEST, LARGEST = 1e-20, 1e20
"""Limits of every number in any units, so that no product or quotient of their squares over- or
underflows."""

PARAMETER_PREFIX = "hazard.parameters."
"""Beginning of the keys that a hazard of the user defines."""

KINDS_PREFIX = "swarm.kinds."
"""Beginning of the keys of kinds of members, whose names are the user's."""

_LARGEST_COUNT = 1_000_000_000

_CUSTOM = "casswarm"  # type of the errors that our own validators raise
_MAX_CHARACTERS = 60
NO_SUCH_KEY = "has no such key"
"""Words of the error of an unknown key, after the name of the scenario."""

_MAX_LINES = 20


# --- types of values


@dataclass(frozen=True)
class Allowed:
    """Values that a key may have, as text that completes 'must be ...' in error messages."""

    text: str


Number = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST),
    Allowed(f"a number between {-LARGEST:g} and {LARGEST:g}"),
]
Positive = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=SMALLEST, le=LARGEST),
    Allowed(f"a number above 0 (from {SMALLEST:g} to {LARGEST:g})"),
]
NotNegative = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=0.0, le=LARGEST),
    Allowed(f"a number, 0 or above (at most {LARGEST:g})"),
]
Count = Annotated[
    int,
    Field(strict=True, ge=1, le=_LARGEST_COUNT),
    Allowed(f"a whole number from 1 to {_LARGEST_COUNT:g}"),
]
Boolean = Annotated[bool, Field(strict=True), Allowed("true or false")]
Text = Annotated[str, Field(strict=True), Allowed("a text in quotes")]
Name = Annotated[
    str,
    Field(strict=True, max_length=100, pattern=r"^\w[^\p{C}\p{Zl}\p{Zp}/\\$]*$"),
    Allowed(
        "a text of 1 to 100 printable characters, without slashes and '$', that starts with a "
        "letter or digit"
    ),
]
Point = Annotated[tuple[Number, Number], Allowed(f"[x, y], two numbers up to {LARGEST:g}")]


def to_plain(value: object) -> Any:
    """`value` with NumPy arrays and scalars converted to lists and numbers, at any depth."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    if type(value) in (list, tuple):
        return [to_plain(item) for item in value]  # type: ignore[attr-defined]
    return value


# --- errors


class Problem(NamedTuple):
    """Problem found in a scenario."""

    message: str
    key: str
    value: Any = None
    allowed: str | None = None


def scenario_error(headline: str, problems: Iterable[Problem]) -> ScenarioError:
    """Error with an indented line for every problem, and the values of the first."""
    problems = tuple(problems)
    lines = [problem.message for problem in problems]
    if len(lines) > _MAX_LINES:
        lines[_MAX_LINES:] = [f"... and {len(lines) - _MAX_LINES} more"]
    first = problems[0]
    return ScenarioError(
        "\n  ".join([f"{headline}:", *lines]),
        key=first.key,
        value=first.value,
        allowed=first.allowed,
        problems=problems,
    )


def invalid(problems: Iterable[Problem]) -> PydanticCustomError:
    """Error for validators to raise, whose messages reach the user word for word."""
    return PydanticCustomError(_CUSTOM, "invalid values", {"problems": list(problems)})


def require_none(messages: Iterable[str]) -> None:
    """Raise the error of messages, each of which begins with the key that it is about."""
    if problems := [Problem(message, message.split()[0]) for message in messages]:
        raise invalid(problems)


def as_text(value: object) -> str:
    """`value` as the user wrote it, cut to a readable length."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print integers of thousands of digits
        return "a number of thousands of digits"
    return shortened(text, _MAX_CHARACTERS)


def problems_of(error: ValidationError | RecursionError, model: type[BaseModel]) -> list[Problem]:
    """Problems that were found in the values of `model`, one for every key."""
    if isinstance(error, RecursionError):
        return [Problem("a nesting of tables or arrays in it is too deep", "")]
    problems: dict[str, Problem] = {}
    for detail in error.errors(include_url=False):
        if detail["type"] == _CUSTOM:
            problems |= {problem.message: problem for problem in detail["ctx"]["problems"]}
        else:
            problem = _problem(detail, model)
            # pydantic calls a list too short whose elements are all wrong
            if not (
                detail["type"] == "too_short"
                and any(key.startswith(f"{problem.key}[") for key in problems)
            ):
                problems.setdefault(problem.key, problem)
    return list(problems.values())


def _problem(detail: ErrorDetails, model: type[BaseModel]) -> Problem:
    location = detail["loc"][:-1] if detail["loc"][-1:] == ("[key]",) else detail["loc"]
    names, field, remaining = _locate(location, model)
    key, value = ".".join(names), detail["input"]
    if detail["type"] == "extra_forbidden":
        return unknown_key(key, model)
    if field is None:
        return Problem(f"{as_text(value)} must be a table", key, value, "a table")
    indices = list(takewhile(lambda part: isinstance(part, int), remaining))
    text = allowed(field)
    if detail["type"] == "missing":
        if not indices:
            return Problem(f"{key} is missing; it must be {text}", key, None, text)
        indices.pop()  # an element is missing: `value` is the list that lacks it
    element = key + "".join(f"[{index}]" for index in indices)
    subject = f"{key} must be" if indices else "it must be"
    return Problem(f"{element} is {as_text(value)}; {subject} {text}", element, value, text)


def _locate(
    location: tuple[int | str, ...], model: type[BaseModel]
) -> tuple[list[str], FieldInfo | None, tuple[int | str, ...]]:
    """Names down to a key, the field of that key, and the remaining location."""
    names: list[str] = []
    field: FieldInfo | None = None
    table: type[BaseModel] | None = model
    named = False
    for depth, part in enumerate(location):
        if table is None:
            return names, field, location[depth:]
        if isinstance(part, int):  # an element of a list of tables
            names[-1] += f"[{part}]"
            continue
        if named:  # one of the tables of a field
            names.append(part)
            named = False
            continue
        name, _, index = part.partition("[")
        names.append(part)
        field = fields(table).get(name)
        table = subtable(field) if field else None
        following = location[depth + 1 : depth + 2]
        named = field is not None and has_names(field)
        if field and (index or named or (following and isinstance(following[0], int))):
            table = element_table(field)
    return names, field, ()


def field_of(key: str, model: type[BaseModel]) -> FieldInfo | None:
    """Field of a dotted key; None if there is no such key."""
    _, field, remaining = _locate(tuple(key.split(".")), model)
    return None if remaining else field


def unknown_key(key: str, model: type[BaseModel]) -> Problem:
    """Problem of a key that does not exist, with the key that was probably meant."""
    shown = shortened(key, 100)
    table, _, leaf = key.rpartition(".")
    keys = known_keys(model)
    if (field := field_of(table, model)) and (element := element_table(field)):
        keys = [f"{table}.{name}" for name in fields(element)]
    siblings = [other for other in keys if other.rpartition(".")[0] == table]
    namesakes = [other for other in keys if other.rpartition(".")[2] == leaf]
    meant = (
        _closest_leaf(leaf, siblings)
        or closest(key, namesakes)
        or next(iter(namesakes), None)
        or _closest_leaf(leaf, keys)
    )
    if meant:
        return Problem(f"unknown key '{shown}'; did you mean '{meant}'?", key)
    if table and not siblings:
        return unknown_key(table, model)
    names = ", ".join(other.rpartition(".")[2] for other in siblings)
    scope = f"of [{table}]" if table else "here"
    custom = "; those of a 'module:function' belong in [hazard.parameters]"
    return Problem(
        f"unknown key '{shown}'; the keys {scope} are {names}{custom if table == 'hazard' else ''}",
        key,
    )


def _closest_leaf(leaf: str, keys: Iterable[str]) -> str | None:
    by_leaf = {key.rpartition(".")[2]: key for key in keys}
    return by_leaf.get(closest(leaf, by_leaf) or "")


# --- the schema


def fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a model by the names that files use."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def subtable(field: FieldInfo) -> type[BaseModel] | None:
    """Model of a field that is a table, else None."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def element_table(field: FieldInfo) -> type[BaseModel] | None:
    """Model of the elements of a field that is a list of tables, or tables by name; else None."""
    kinds = [kind for kind in get_args(field.annotation) if isinstance(kind, type)]
    return next((kind for kind in kinds if issubclass(kind, BaseModel)), None)


def has_names(field: FieldInfo) -> bool:
    """True for a field that is tables by name."""
    return get_origin(field.annotation) is dict and element_table(field) is not None


def allowed(field: FieldInfo) -> str:
    """Values that a field may have, as text."""
    if table := subtable(field):
        return f"a table with the keys {', '.join(fields(table))}"
    return next(_allowed_texts([*field.metadata, field.annotation]))


def _allowed_texts(annotations: Iterable[Any]) -> Iterator[str]:
    for annotation in annotations:
        if isinstance(annotation, Allowed):
            yield annotation.text
        # innermost last: the metadata of Annotated are more specific than the annotated type
        yield from _allowed_texts(reversed(get_args(annotation)))


def known_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    """All dotted keys of a model and of its tables."""
    keys: list[str] = []
    for name, field in fields(model).items():
        keys.append(prefix + name)
        if table := subtable(field):
            keys += known_keys(table, f"{prefix}{name}.")
    return keys


def set_value(data: dict[str, Any], key: str, value: object) -> None:
    """Set a value at a dotted key of nested tables; None removes the key."""
    if key.startswith(PARAMETER_PREFIX):  # whose names may hold dots
        tables, leaf = ["hazard", "parameters"], key.removeprefix(PARAMETER_PREFIX)
    else:
        *tables, leaf = key.split(".")
    table = data
    for name in tables:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            message = f"{key} cannot be set: {name} is {as_text(table)}, not a table of keys"
            raise scenario_error("values that do not fit together", [Problem(message, key)])
    table.pop(leaf, None)
    if value is not None:
        table[leaf] = value


# --- tables


_PYDANTIC = frozenset(dir(BaseModel))


class Table(BaseModel):
    """Base of the tables: immutable, without unknown keys, with errors in plain words."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**to_plain(values))
        except (ValidationError, RecursionError) as error:
            headline = f"invalid {type(self).__name__}"
            raise scenario_error(headline, problems_of(error, type(self))) from None

    def __dir__(self) -> list[str]:
        """Names of the table's own: pydantic's, most of them deprecated, are not listed."""
        return [name for name in super().__dir__() if name[0] == "_" or name not in _PYDANTIC]

    def __setattr__(self, name: str, value: object) -> None:
        if name.startswith("_"):
            super().__setattr__(name, value)
            return
        table = type(self).__name__.removesuffix("Options").removesuffix("Table").lower()
        key = name if table == "scenario" else f"{table}.{name}"
        raise ScenarioError(
            f"scenarios are immutable, so {key} cannot be set; a changed copy is "
            f"scenario.with_values({{{key!r}: ...}})",
            key=key,
            value=value,
        )

    # Otherwise pydantic would call this constructor for every table inside a scenario, and the
    # errors would lose the name of the table.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]
