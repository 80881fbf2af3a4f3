"""Text of scenario files."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from typing import Any

import tomli_w
from pydantic import BaseModel

from ..errors import ScenarioError
from .hazard_section import importable_name
from .validation import fields, subtable

# tomli_w escapes line breaks in texts, so that a bracket before a line break opens an array
_SCALARS = re.compile(r"\[\n((?: +[^\[\]\"{},\n]+,\n)+) *\]")


def toml_text(data: Mapping[str, Any]) -> str:
    """Text of a scenario file with these tables, with a point per line.

    Raises
    ------
    ScenarioError
        The hazard is a function that cannot be imported by a name.
    """
    hazard = data["hazard"]
    if callable(hazard["kind"]):
        try:
            kind = importable_name(hazard["kind"])
        except ScenarioError as error:
            raise ScenarioError(
                f"scenario '{data['name']}' cannot be saved: hazard.kind is a function that a file "
                f"cannot name as 'module:function': {error}; move it into a module",
                key="hazard.kind",
                value=hazard["kind"],
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
    """Text of a scenario file with the descriptions in `model` as comments."""
    known, lines = fields(model), []
    for line in text.removesuffix("\n").split("\n"):  # texts may hold other line separators
        table, key = re.fullmatch(r"\[(\w+)\]", line), re.match(r"(\w+) = ", line)
        description: str | None = None
        if table and table[1] in fields(model):
            field = fields(model)[table[1]]
            known = fields(subtable(field) or model)
            description = field.description
        elif line.startswith("["):
            known = {}  # tables inside a table belong to the user
        elif key and key[1] in known:
            description = known[key[1]].description
        lines += [*(f"# {part}" for part in textwrap.wrap(description or "", 96)), line]
    return "\n".join(lines) + "\n"
