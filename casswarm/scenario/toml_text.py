"""Text of scenario files, with comments if asked for."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from typing import Any

import tomli_w
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..errors import ScenarioError
from .hazard_table import importable_name
from .validation import element_table, field_of, fields, subtable

# tomli_w escapes line breaks in texts, so that a bracket before a line break opens an array
_SCALARS = re.compile(r"\[\n((?: +[^\[\]\"{},\n]+,\n)+) *\]")


def toml_text(data: Mapping[str, Any]) -> str:
    """Text of a scenario file with these tables, with a point per line."""
    hazard = data["hazard"]
    if callable(hazard["kind"]):
        try:
            kind = importable_name(hazard["kind"])
        except ScenarioError as error:
            raise ScenarioError(
                f"scenario '{data['name']}' cannot be saved: hazard.kind is a function that a file "
                f"cannot name as 'module:function': {error}; move it into a module",
                key="hazard.kind",
                value=repr(hazard["kind"]),
            ) from None
        data = {**data, "hazard": {**hazard, "kind": kind}}
    return _escaped(_SCALARS.sub(_on_one_line, tomli_w.dumps(data)))


def _escaped(text: str) -> str:
    """TOML whose strings hold no character that a terminal or an editor does not show as itself."""
    return "".join(c if c.isprintable() or c == "\n" else f"\\U{ord(c):08x}" for c in text)


def _on_one_line(array: re.Match[str]) -> str:
    items = (line.strip().removesuffix(",") for line in array[1].splitlines())
    return f"[{', '.join(items)}]"


def annotated(text: str, model: type[BaseModel]) -> str:
    """Text of a scenario file with comments: what every key is, and the keys that it leaves out."""
    table, known, missing = "", fields(model), dict[str, FieldInfo]()
    lines: list[str] = []
    for line in text.removesuffix("\n").split("\n"):  # texts may hold other line separators
        header = re.fullmatch(r"\[([\w.]+)\]|\[\[([\w.]+)\]\]", line)
        key = re.match(r"(\w+) = ", line)
        description: str | None = None
        if header:
            name = header[1] or header[2]
            missing.pop(name.removeprefix(f"{table}.").partition(".")[0], None)
            lines = _with_optional(lines, table, missing)
            again, table, field = name == table, name, field_of(name, model)
            inner = field and (subtable(field) or element_table(field))
            known = fields(inner) if inner else {}  # others are the user's
            missing, description = dict(known), field.description if field else None
            if again:  # the keys of the next element of a list of tables
                known, missing, description = {}, {}, None
        elif key and key[1] in known:
            missing.pop(key[1], None)
            description = known[key[1]].description
        lines += [*_comment(description or ""), line]
    return "\n".join(_with_optional(lines, table, missing)) + "\n"


def _with_optional(lines: list[str], table: str, missing: Mapping[str, FieldInfo]) -> list[str]:
    """Lines of a table, and the keys that it could also have, commented out."""
    optional: list[str] = []
    tables: list[str] = []  # last, since the keys that follow are theirs
    for key, field in missing.items():
        for example in field.examples or ():
            listed = isinstance(example, list) and isinstance(example[0], dict)
            nested = listed or isinstance(example, dict)
            text = tomli_w.dumps({table: {key: example}} if nested else {key: example})
            shown = _SCALARS.sub(_on_one_line, text).strip().split("\n")
            part = tables if nested else optional
            part += [*_comment(field.description or ""), *(f"# {line}" for line in shown)]
    end = len(lines) - (lines[-1:] == [""])  # the blank line before the next table
    return [*lines[:end], *optional, *tables, *lines[end:]]


def _comment(text: str) -> list[str]:
    return [f"# {part}" for part in textwrap.wrap(text, 78)]
