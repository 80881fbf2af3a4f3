"""Results that notebooks show as tables and pictures."""

from __future__ import annotations

from importlib import import_module


class Displayed:
    """Base of results that a notebook shows as HTML, with a table and a picture.

    What is shown is decided in `casswarm.results.display`, a room above: it is looked up by name
    when a notebook asks for it, so that a result itself knows neither tables nor figures.
    """

    def _repr_html_(self) -> str:
        html: str = import_module("casswarm.results.display").html(self)
        return html
