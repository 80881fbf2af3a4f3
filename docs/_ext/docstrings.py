"""Docstrings in numpydoc style, read by napoleon's parser.

Two things differ from napoleon as it is: a property's docstring is plain text, where napoleon takes
what stands before its first colon for a type; and casswarm's names in types are links.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.ext import napoleon

import casswarm

NAMES = re.compile(rf"\b({'|'.join(sorted(casswarm.__all__, key=len, reverse=True))})\b")
TYPE = re.compile(r"(?<=\()\*([^*]+)\*(?=\))|^\*([^*]+)\*(?= --|$)")
HYPHENS, DASH = " -- ", " – "


def parsed(
    app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Turn the sections of a docstring into reStructuredText."""
    kind = "method" if what in ("attribute", "property", "data") else what
    found = napoleon.NumpyDocstring(lines, app.config, app, kind, name, value, options).lines()
    lines[:] = [linked(line) for line in found]


def linked(line: str) -> str:
    """A line with links in its type, if it has one, and a dash where napoleon puts two hyphens."""
    field, colon, text = line.partition(": ") if line.startswith(":returns") else ("", "", line)
    return field + colon + TYPE.sub(_linked_type, text).replace(HYPHENS, DASH, 1)


def _linked_type(found: re.Match[str]) -> str:
    words = found[1] or found[2]
    parts = NAMES.split(words)
    if len(parts) == 1:
        return found[0]
    shown = [
        f":public:`{part} <casswarm.{part}>`"
        if place % 2
        else f"*{part.strip()}*"
        if part.strip()
        else ""
        for place, part in enumerate(parts)
    ]
    return " ".join(filter(None, shown))


def dashes(_app: Sphinx, doctree: nodes.document) -> None:
    """Put a dash where Sphinx puts two hyphens, between an exception and what is said of it."""
    for text in list(doctree.findall(nodes.Text)):
        if text == HYPHENS:
            text.parent.replace(text, nodes.Text(DASH))


def setup(app: Sphinx) -> dict[str, Any]:
    """In place of napoleon's own handler."""
    for name, default, rebuild, types in napoleon.Config._config_values:
        app.add_config_value(name, default, rebuild, types=types)
    app.connect("autodoc-process-docstring", parsed)
    app.connect("doctree-read", dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
