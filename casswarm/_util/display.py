"""Results that notebooks show as tables and pictures."""

from __future__ import annotations

from importlib import import_module

RENDERER = ""
"""Module whose function `html` renders a result; the package names it (`casswarm.__init__`)."""


class Displayed:
    """Base of results that a notebook shows as HTML, with a table and a picture.

    The renderer is looked up by name when a notebook asks for it, so a result itself imports
    neither tables nor figures.
    """

    def _repr_html_(self) -> str:
        html: str = import_module(RENDERER).html(self)
        return html
