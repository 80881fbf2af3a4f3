"""Validation errors in plain words: which key, what was given, what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import takewhile
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from .fields import Allowed

_OWN_WORDS = "casswarm"
_LONGEST_VALUE = 60
_MAX_LINES = 20


def wrong(lines: Iterable[str]) -> PydanticCustomError:
    """Error for validators to raise, whose lines reach the user word for word."""
    return PydanticCustomError(_OWN_WORDS, "wrong values", {"lines": list(lines)})


def report(headline: str, lines: Iterable[str]) -> str:
    """Headline, and an indented line for everything that is wrong."""
    lines = list(lines)
    if len(lines) > _MAX_LINES:
        lines[_MAX_LINES:] = [f"... and {len(lines) - _MAX_LINES} more"]
    return "\n  ".join([f"{headline}:", *lines])


def shown(value: object) -> str:
    """`value` as the user wrote it, cut to a readable length."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print integers of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def nearest(word: str, words: Iterable[str]) -> str | None:
    """One of `words`, that `word` was probably meant to be, if any."""
    found = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return found[0] if found else None


def problems(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """Lines, one for every key of `model` that `error` complains about."""
    lines: dict[str, str] = {}
    for detail in error.errors(include_url=False):
        if detail["type"] == _OWN_WORDS:
            lines.update({line: line for line in detail["ctx"]["lines"]})
        else:
            key, line = _line(detail, model)
            # pydantic calls a list too short whose elements are all wrong
            if not (detail["type"] == "too_short" and any(k.startswith(f"{key}[") for k in lines)):
                lines.setdefault(key, line)
    return list(lines.values())


def _line(detail: ErrorDetails, model: type[BaseModel]) -> tuple[str, str]:
    names, field, rest = _locate(detail["loc"], model)
    key = ".".join(names)
    if detail["type"] == "extra_forbidden":
        return key, unknown_key(key, model)
    if field is None:
        return key, f"{shown(detail['input'])} must be a table"
    indices = list(takewhile(lambda part: isinstance(part, int), rest))
    words = allowed(field)
    if detail["type"] == "missing":
        if not indices:
            return key, f"{key} is missing; it must be {words}"
        indices.pop()  # an element is missing: what was given is the list that lacks it
    element = key + "".join(f"[{index}]" for index in indices)
    where = f"{key} must be" if indices else "it must be"
    return (
        key if not indices else element,
        f"{element} is {shown(detail['input'])}; {where} {words}",
    )


def _locate(
    location: tuple[int | str, ...], model: type[BaseModel]
) -> tuple[list[str], FieldInfo | None, tuple[int | str, ...]]:
    """Names down to a key, the field found there, and what is left of the location."""
    names: list[str] = []
    field: FieldInfo | None = None
    table: type[BaseModel] | None = model
    for depth, part in enumerate(location):
        if table is None:
            return names, field, location[depth:]
        names.append(str(part))
        field = fields(table).get(str(part))
        table = subtable(field) if field else None
    return names, field, ()


def fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a model by the names that files use."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def subtable(field: FieldInfo) -> type[BaseModel] | None:
    """Model of a field that is a table of its own."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def allowed(field: FieldInfo) -> str:
    """Words for what a field may hold."""
    table = subtable(field)
    if table is not None:
        return f"a table with the keys {', '.join(fields(table))}"
    words = _words([*field.metadata, field.annotation])
    assert words is not None, field
    return words


def _words(annotations: Iterable[Any]) -> str | None:
    for annotation in annotations:
        if isinstance(annotation, Allowed):
            return annotation.words
        # innermost last: the metadata of Annotated say it better than the type they annotate
        found = _words(reversed(get_args(annotation)))
        if found:
            return found
    return None


def known_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    """All keys of a model and of its tables, dotted."""
    keys: list[str] = []
    for name, field in fields(model).items():
        keys.append(prefix + name)
        table = subtable(field)
        if table is not None:
            keys += known_keys(table, f"{prefix}{name}.")
    return keys


def unknown_key(key: str, model: type[BaseModel]) -> str:
    """Line for a key that does not exist, with the one that was probably meant."""
    known = known_keys(model)
    table, _, leaf = key.rpartition(".")
    siblings = [other for other in known if other.rpartition(".")[0] == table]
    namesakes = [other for other in known if other.rpartition(".")[2] == leaf]
    meant = (
        _nearest_leaf(leaf, siblings)
        or nearest(key, namesakes)
        or next(iter(namesakes), None)
        or _nearest_leaf(leaf, known)
    )
    if meant:
        return f"unknown key '{key}'; did you mean '{meant}'?"
    names = ", ".join(other.rpartition(".")[2] for other in siblings or known)
    own = "; those of a 'module:function' stand in [hazard.parameters]" if table == "hazard" else ""
    return f"unknown key '{key}'; the keys {f'of [{table}]' if table else 'here'} are {names}{own}"


def _nearest_leaf(leaf: str, keys: Iterable[str]) -> str | None:
    by_leaf = {key.rpartition(".")[2]: key for key in keys}
    return by_leaf.get(nearest(leaf, by_leaf) or "")
