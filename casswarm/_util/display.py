"""Results that are drawn, and that notebooks show as tables and pictures."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..typing import ThemeName

RENDERER = ""
"""Module whose functions `html` and `figure` render a result; the package names it
(`casswarm.__init__`)."""


class Displayed:
    """Base of results with a picture, which a notebook shows as HTML with a table, too.

    The renderer is looked up by name when it is needed, so a result itself imports neither tables
    nor figures.
    """

    def plot(
        self, scenario: Any = None, *, theme: ThemeName | None = None, **options: Any
    ) -> Figure:
        """Picture of the result.

        Parameters
        ----------
        scenario : Scenario, optional
            For a guide or a joint plan, which do not hold theirs: its hazard and target are drawn.
        theme : {"page", "column", "slide"}, optional
            Size of the figure: see `casswarm.figures.theme`; by default that of the context.
        **options
            ``title=`` and ``ax=``, as of all `casswarm.figures`: a text or None for no title; the
            axes of matplotlib to draw into, of which the figure is returned.

        Returns
        -------
        Figure
            Of matplotlib, which notebooks show and `casswarm.figures.save` writes.
        """
        figure: Figure = import_module(RENDERER).figure(self, scenario, theme, **options)
        return figure

    def _repr_html_(self) -> str:
        html: str = import_module(RENDERER).html(self)
        return html
