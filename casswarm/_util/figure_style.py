"""Themes of figures: sizes fit for print, and colours that colour-blind readers can distinguish.

A theme is a figure width with matching sizes of text and lines. Figures use the theme of the
context, `theme`, by default that of a page, and are saved at exactly its width.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np
from matplotlib import rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend

from ..typing import ThemeName
from .documents import figure_bytes

P = ParamSpec("P")

# M. Okabe, K. Ito, Color Universal Design, 2002, revised 2008, https://jfly.uni-koeln.de/color/
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
MEMBERS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION)
INK = "#222222"
GREY = "#8C8C8C"
GRID = "#DDDDDD"


@dataclass(frozen=True)
class Theme:
    """Sizes of a figure.

    Parameters
    ----------
    width : float
        Inches.
    font_size : float
        Points.
    line_scale : float
        Factor of the lines and markers of a page.
    aspect : float
        Default height over width.
    """

    width: float
    font_size: float
    line_scale: float
    aspect: float

    @property
    def narrow(self) -> bool:
        """True if panels and legends are stacked."""
        return self.width < 5

    @property
    def characters(self) -> int:
        """Number of average characters that fit side by side."""
        return int(72 * self.width / (0.58 * self.font_size))

    def aspect_of(self, lines: float) -> float:
        """Height over width of a figure as high as this number of lines of text."""
        return lines * 1.2 * self.font_size / 72 / self.width


THEMES: dict[ThemeName, Theme] = {
    "column": Theme(3.5, 8.0, 0.8, 0.72),
    "page": Theme(7.16, 9.0, 1.0, 0.46),
    "slide": Theme(10.0, 16.0, 1.7, 0.52),
}
"""A column and a double column of a journal (those of the IEEE), and a slide."""

_CURRENT = ContextVar("theme", default=THEMES["page"])


@contextmanager
def theme(name: ThemeName) -> Iterator[None]:
    """Draw figures in the theme of this name, of `THEMES`, while in the context.

    Raises
    ------
    ValueError
        The name is unknown.
    """
    if name not in THEMES:
        raise ValueError(f"theme {name!r} is unknown; allowed: {', '.join(THEMES)}")
    token = _CURRENT.set(THEMES[name])
    try:
        yield
    finally:
        _CURRENT.reset(token)


def current_theme() -> Theme:
    """Theme of the context."""
    return _CURRENT.get()


def themed(function: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorate a function that draws a figure: draw in the theme of the context.

    The result does not depend on the user's own settings of matplotlib. Figures with maps get the
    height that their maps need.
    """

    @wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context(settings(current_theme())):
            fig = function(*args, **kwargs)
            every = (axes for parent in fig.axes for axes in (parent, *parent.child_axes))
            colorbars = (axes for axes in every if isinstance(axes, Axes))
            _fix_tick_labels(axes for axes in colorbars if axes.get_subplotspec() is None)
            _fit_height(fig)
        return fig

    return draw


@cache
def settings(chosen: Theme) -> dict[Any, Any]:
    """Matplotlib's settings for a theme: casswarm.mplstyle with its numbers scaled."""
    sheet = rc_params_from_file(Path(__file__).with_name("casswarm.mplstyle"), False, False)
    scaled_numbers = {
        key: value * chosen.line_scale if isinstance(value, float) else value
        for key, value in sheet.items()
    }
    fixed = {
        "font.size": chosen.font_size,
        "legend.handlelength": 2.4,
        "axes.titley": 1.0,  # not moved above the ticks, which takes the layout of all of them
    }
    return scaled_numbers | fixed


def scaled(size: float = 1.0) -> float:
    """Width of a line, or size of a marker, in points: `size` on a page."""
    return size * current_theme().line_scale


def single_panel(aspect: float | None = None, *title: str) -> tuple[Figure, Axes]:
    """Figure with one axes under a title; `aspect` is its height over its width."""
    fig, axes = panels(1, 1, aspect, *title)
    return fig, axes[0]


class ShownFigure(Figure):
    """Figure that notebooks show, also without matplotlib's inline backend."""

    def _repr_png_(self) -> bytes:
        return figure_bytes(self)


def panels(
    number: int, columns: int, aspect: float | None = None, *title: str, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Figure with a grid of axes, row by row, and a title, without pyplot's global state.

    `options` are those of ``Figure.subplots``.
    """
    width = current_theme().width
    height = width * (current_theme().aspect if aspect is None else aspect)
    fig = ShownFigure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(fig)
    add_title(fig, *title)
    rows = -(-number // columns)
    axes = list(fig.subplots(rows, columns, squeeze=False, **options).ravel())
    for unused in axes[number:]:
        unused.set_visible(False)
    _fix_tick_labels(axes)
    return fig, axes[:number]


def _fix_tick_labels(some: Iterable[Axes]) -> None:
    """Set the size of tick labels in points.

    Matplotlib computes how many ticks fit when a figure is written, outside the theme's settings.
    """
    for axes in some:
        axes.tick_params(which="both", labelsize=FontProperties(size="small").get_size_in_points())


def _fit_height(fig: Figure) -> None:
    """Give a figure the height at which its maps fill its width, and fix its layout.

    The layout takes long, so it is computed once, or twice if the height is far off: with another
    height, only the rows of maps and what is beside them become higher or lower.
    """
    maps = [a for a in fig.axes if a.get_aspect() != "auto" and a.get_subplotspec() is not None]
    engine = fig.get_layout_engine()
    if not maps or engine is None:
        return
    for axes in maps:  # constrained layout may oscillate for axes that shrink in their boxes
        axes.set_aspect("auto")
    engine.execute(fig)
    missing = _missing_height(fig, maps)
    if abs(missing) > 0.1 * fig.get_figheight():  # other ticks may need other margins
        fig.set_figheight(fig.get_figheight() + missing)
        engine.execute(fig)
    fig.set_layout_engine("none")
    _stretch_rows(fig, maps)
    for axes in maps:
        axes.set_aspect("equal")


def _missing_height(fig: Figure, maps: list[Axes]) -> float:
    """Inches that a figure lacks in height (negative: has too many) for its rows of maps."""
    rows = len({round(axes.get_position().y0, 9) for axes in maps})
    wide, high = fig.get_size_inches() * maps[0].get_position().size
    (west, east), (south, north) = maps[0].get_xlim(), maps[0].get_ylim()
    missing = rows * (wide * (north - south) / (east - west) - high)
    return max(float(missing), 0.3 * fig.get_figwidth() - fig.get_figheight())


def _stretch_rows(fig: Figure, maps: list[Axes]) -> None:
    """Change the height of a figure by that which its rows of maps lack or have too much."""
    width, height = fig.get_size_inches()
    boxes = {axes: axes.get_position().frozen() for axes in fig.axes}
    rows = np.unique([boxes[axes].intervaly.round(9) for axes in maps], axis=0)
    missing = _missing_height(fig, maps) / len(rows)
    edges = np.array([0.0, *height * rows.ravel(), height])  # inches, from the bottom
    moved = edges + missing * np.repeat(np.arange(len(rows) + 1), 2)
    fig.set_size_inches(width, moved[-1])
    for axes, box in boxes.items():
        low, high = np.interp(height * box.intervaly, edges, moved) / moved[-1]
        # a colorbar beside rows has a fixed ratio of its sides
        wider = 1.0 if axes in maps else (high - low) * moved[-1] / (box.height * height)
        axes.set_position((box.x0, low, box.width * wider, high - low))


def add_title(fig: Figure, *parts: str) -> None:
    """Title a figure with those parts that are not empty, wrapped to its width."""
    text = ": ".join(part for part in parts if part)
    if text:
        fig.suptitle(wrap(text))


def wrap(text: object, fraction: float = 1.0) -> str:
    """Wrap text to a fraction of the figure's width, but not around equals signs."""
    text = str(text).replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}")
    width = max(18, int(fraction * current_theme().characters))
    return textwrap.fill(text, width, break_long_words=False)


def add_legend(fig: Figure, axes: Axes) -> Legend:
    """Add the legend of a map: on the right of a wide figure, below a narrow one."""
    handles, labels = axes.get_legend_handles_labels()
    chosen = current_theme()
    if not chosen.narrow:
        return fig.legend(handles, labels, loc="outside right center", borderpad=1.0)
    longest = max(len(part) for label in labels for part in label.split("\n"))
    fitting = int(chosen.characters / (0.83 * (longest + 9)))  # handle and gaps are 9 wide
    return fig.legend(handles, labels, loc="outside lower center", ncols=max(1, fitting))


def marker(
    shape: str, size: float, color: str = "white", edge: str = INK, edge_width: float = 1.0
) -> dict[str, Any]:
    """Arguments of ``Axes.plot`` for markers without a line; sizes are those on a page."""
    return {
        "linestyle": "",
        "marker": shape,
        "markersize": scaled(size),
        "color": color,
        "markeredgecolor": edge,
        "markeredgewidth": scaled(edge_width),
    }


def despine(axes: Axes, grid: str = "y") -> None:
    """Remove the frame but for its axes, and add a light grid along x or y.

    With a grid along x the y axis has categories: it needs neither a line nor ticks.
    """
    axes.spines[["top", "right"]].set_visible(False)
    if grid == "x":
        axes.spines["left"].set_visible(False)
        axes.tick_params(axis="y", length=0)
    axes.grid(axis="x" if grid == "x" else "y", color=GRID)
    axes.set_axisbelow(True)
