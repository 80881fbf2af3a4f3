r"""The help of commands as sphinx-click gives it, made easier to read.

Examples, which click keeps as they are after ``\b``, become code; an option's default and choices,
a line.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

BAR = "| "  # which sphinx-click puts before every line after \b


def examples_as_code(_app: Sphinx, _context: object, lines: list[str]) -> None:
    """Turn blocks of a heading and indented lines into a heading and code."""
    found: list[str] = []
    inside = False
    for line in lines:
        if not line.startswith(BAR):
            inside = False
            found.append(line)
            continue
        text = line.removeprefix(BAR)
        if text.startswith(" "):
            if not inside:
                found += ["", ".. code-block:: text", ""]
            inside = True
            found.append(f"   {text.strip()}")
        else:
            inside = False
            found += ["", text]
    lines[:] = [*found, ""]


def facts_in_a_line(_app: Sphinx, _context: object, lines: list[str]) -> None:
    """Turn the fields for default and choices into sentences."""
    for place, line in enumerate(lines):
        default = re.fullmatch(r"( +):default: ``'?(.*?)'?``", line)
        choices = re.fullmatch(r"( +):options: (.*)", line)
        if default:
            lines[place] = f"{default[1]}Default: ``{default[2]}``."
            if place + 1 < len(lines) and ":options:" in lines[place + 1]:
                lines[place] += "\n"
        elif choices:
            words = ", ".join(f"``{word}``" for word in choices[2].split(" | "))
            lines[place] = f"{choices[1]}One of {words}."
    lines[:] = [part for line in lines for part in line.split("\n")]


def setup(app: Sphinx) -> dict[str, Any]:
    """After sphinx-click, whose events these are."""
    app.setup_extension("sphinx_click")
    app.connect("sphinx-click-process-description", examples_as_code)
    app.connect("sphinx-click-process-options", facts_in_a_line)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
