r"""The output of sphinx-click, made readable: examples as code, defaults and choices as a line.

sphinx-click marks each line of a paragraph that follows ``\b`` in a docstring with a bar, and
prints defaults and choices as field lists.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

BAR = "| "


def format_examples(_app: Sphinx, _context: object, lines: list[str]) -> None:
    """Turn indented lines of a marked paragraph into a code block."""
    formatted: list[str] = []
    in_code = False
    for line in lines:
        text = line.removeprefix(BAR)
        is_code = text != line and text.startswith(" ")
        if is_code and not in_code:
            formatted += ["", ".. code-block:: text", ""]
        if is_code:
            formatted.append(f"   {text.strip()}")
        else:
            formatted += ["", text] if text != line else [line]
        in_code = is_code
    lines[:] = [*formatted, ""]


def format_options(_app: Sphinx, _context: object, lines: list[str]) -> None:
    """Turn the fields for default and choices into sentences."""
    formatted: list[str] = []
    for line in lines:
        default = re.fullmatch(r"( +):default: ``'?(.*?)'?``", line)
        choices = re.fullmatch(r"( +):options: (.*)", line)
        if default:
            formatted += [f"{default[1]}Default: ``{default[2]}``.", ""]
        elif choices:
            names = ", ".join(f"``{name}``" for name in choices[2].split(" | "))
            formatted.append(f"{choices[1]}One of {names}.")
        else:
            formatted.append(line)
    lines[:] = formatted


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to sphinx-click's events."""
    app.setup_extension("sphinx_click")
    app.connect("sphinx-click-process-description", format_examples)
    app.connect("sphinx-click-process-options", format_options)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
