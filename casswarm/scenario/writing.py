"""Scenario files, written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import tomli_w

from ..errors import ScenarioError
from .kinds import importable_name

# tomli_w escapes line breaks in texts, so that a bracket before a line break opens an array
_SCALARS = re.compile(r"\[\n((?: +[^\[\]\"{},\n]+,\n)+) *\]")


def toml_text(data: Mapping[str, Any]) -> str:
    """Text of a scenario file with the given tables, points on one line each.

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
                f"cannot name as 'module:function': {error}; move it into a module"
            ) from None
        data = {**data, "hazard": {**hazard, "kind": kind}}
    return _SCALARS.sub(_on_one_line, tomli_w.dumps(data))


def _on_one_line(array: re.Match[str]) -> str:
    items = (line.strip().removesuffix(",") for line in array[1].splitlines())
    return f"[{', '.join(items)}]"
