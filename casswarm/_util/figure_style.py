"""Themes of figures: sizes fit for print, and colours that colour-blind readers can distinguish.

A theme is a figure width with matching sizes of text and lines. Figures use the theme of the
context, `theme`, by default that of a page, and are saved at exactly its width.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeAlias

import numpy as np
from matplotlib import rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, FuncFormatter, Locator, LogLocator, MaxNLocator
from matplotlib.transforms import ScaledTranslation
from typing_extensions import override

from ..typing import ThemeName
from .documents import figure_bytes
from .text import shown

P = ParamSpec("P")

AxesLike: TypeAlias = Axes | Sequence[Axes]
"""Axes to draw a figure into: one, or as many as it has panels."""

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
        raise ValueError(f"theme {shown(name)} is unknown; allowed: {', '.join(THEMES)}")
    with _drawing_in(THEMES[name]):
        yield


@contextmanager
def _drawing_in(chosen: Theme) -> Iterator[None]:
    token = _CURRENT.set(chosen)
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
    height that their maps need. Axes that are given by the keyword `ax` are as wide as they are.
    """

    @wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        given: Any = kwargs.get("ax")
        chosen = current_theme()
        if given is not None:
            chosen = replace(chosen, width=_inches(np.ravel(given)[0]))
        with rc_context(settings(current_theme())), _drawing_in(chosen):
            fig = function(*args, **kwargs)
            parents: list[Any] = [fig] if given is None else list(np.ravel(given))
            _show_literally(parents)
            if given is not None:
                return fig
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


def _show_literally(parents: list[Any]) -> None:
    """Show dollar signs in names of users as they are, but formulas in titles and tick labels."""
    kept = {each.heading if isinstance(each, ShownFigure) else each.title for each in parents}
    for parent in parents:
        for axis in parent.findobj(Axis):
            kept.add(axis.label)
            names = isinstance(axis.get_major_formatter(), FuncFormatter)  # of set_ticks
            if not (names and isinstance(axis.get_major_locator(), FixedLocator)):
                kept |= set(axis.findobj(Text))
        for text in set(parent.findobj(Text)) - kept:
            text.set_parse_math(False)


def literal(text: str) -> str:
    """Text for titles that shows dollar signs of names in it."""
    return text.replace("$", "\\$")


class CenteredTitle(ConstrainedLayoutEngine):
    """Constrained layout in which the title of a `ShownFigure` is centred over its panels."""

    @override
    def execute(self, fig: Figure) -> Any:
        super().execute(fig)
        heading = getattr(fig, "heading", None)
        if heading is None or not heading.get_text():
            return
        boxes = [a.get_position() for a in fig.axes if a.get_subplotspec() and a.get_visible()]
        center = (min(box.x0 for box in boxes) + max(box.x1 for box in boxes)) / 2
        space = 2 * min(center, 1 - center)
        heading.set_x(center)
        size = heading.get_window_extent().width / fig.bbox.width
        if size > space:
            longest = max(map(len, heading.get_text().split("\n")))
            heading.set_text(_filled(heading.get_text(), int(0.98 * longest * space / size)))
            super().execute(fig)
            half = heading.get_window_extent().width / fig.bbox.width / 2
            heading.set_x(np.clip(center, min(half, 0.5), max(1 - half, 0.5)))


class ShownFigure(Figure):
    """Figure that notebooks show, also without matplotlib's inline backend."""

    heading: Text | None = None

    def _repr_png_(self) -> bytes:
        return figure_bytes(self)


def single_panel(
    aspect: float | None = None, title: str = "", ax: AxesLike | None = None
) -> tuple[Figure, Axes]:
    """Figure with one axes under a title; `aspect` is its height over its width."""
    fig, axes = panels(1, 1, aspect, title, ax)
    return fig, axes[0]


def panels(
    number: int,
    columns: int,
    aspect: float | None = None,
    title: str = "",
    ax: AxesLike | None = None,
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """Figure with a grid of axes, row by row, and a title, without pyplot's global state.

    `options` are those of ``Figure.subplots``. If axes are given, they are the panels.

    Raises
    ------
    ValueError
        The number of given axes is not that of the panels.
    """
    if ax is not None:
        given: list[Axes] = list(np.ravel(np.asarray(ax, object)))
        if len(given) != number:
            raise ValueError(
                f"ax has {len(given)} axes for a figure of {number} panels; pass as many in a "
                "sequence, or leave ax out"
            )
        add_title(given[0], title if number == 1 else "")
        _fix_tick_labels(given)
        return given[0].get_figure(root=True), given  # type: ignore[return-value]
    width = current_theme().width
    height = width * (current_theme().aspect if aspect is None else aspect)
    fig = ShownFigure(figsize=(width, height), layout=CenteredTitle())
    FigureCanvasAgg(fig)
    rows = -(-number // columns)
    axes = list(fig.subplots(rows, columns, squeeze=False, **options).ravel())
    for unused in axes[number:]:
        unused.set_visible(False)
    add_title(axes[0], title)
    _fix_tick_labels(axes)
    return fig, axes[:number]


def is_given(axes: Axes) -> bool:
    """True for axes of the user's, in whose figure only they may be drawn on."""
    return not isinstance(axes.figure, ShownFigure)


def _inches(axes: Axes) -> float:
    """Width of axes."""
    return float(axes.get_window_extent().width / axes.get_figure(root=True).dpi)  # type: ignore[union-attr]


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


def heading(title: str | None, *parts: str) -> str:
    """Title of a figure: the user's, none if that is None, by default all parts but empty ones."""
    return "" if title is None else title or ": ".join(part for part in parts if part)


def add_title(axes: Axes, text: str) -> None:
    """Title axes of the user's, or the figure of others, wrapped to the width."""
    fig = axes.figure
    if text and isinstance(fig, ShownFigure):
        fig.heading = fig.suptitle(wrap(text))
    elif text:
        axes.set_title(wrap(text))


def wrap(text: object, fraction: float = 1.0) -> str:
    """Wrap text to a fraction of the figure's width, but not around equals signs."""
    text = str(text).replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}")
    return _filled(text, int(fraction * current_theme().characters))


def _filled(text: str, width: int) -> str:
    return textwrap.fill(text, max(18, width), break_long_words=False)


def label_panels(axes: Sequence[Axes], xlabel: str = "", ylabel: str = "") -> None:
    """Label the axes of all panels at once."""
    for text, one, every in (
        (xlabel, "supxlabel", "set_xlabel"),
        (ylabel, "supylabel", "set_ylabel"),
    ):
        if text and not is_given(axes[0]):
            getattr(axes[0].figure, one)(text, fontsize="medium")
        elif text:
            for panel in axes:
                getattr(panel, every)(text)


def label_outer(axes: Axes) -> None:
    """Remove labels that a panel shares with those beside and below, but from the user's axes."""
    if not is_given(axes):
        axes.label_outer()


def add_legend(
    axes: Axes, handles: Sequence[Any] | None = None, ncols: int | None = None, **options: Any
) -> Legend:
    """Add a legend below the panels; if `ncols` is None, on the right of a wide figure.

    That of axes of the user's is below them. `options` are those of ``Figure.legend``.
    """
    chosen, fig = current_theme(), axes.figure
    shown: list[Any] = list(axes.get_legend_handles_labels()[0] if handles is None else handles)
    if ncols is None:
        if not (chosen.narrow or is_given(axes)):
            style: dict[str, Any] = {"loc": "outside right center", "borderpad": 1.0} | options
            return fig.legend(handles=shown, **style)
        longest = max(len(part) for each in shown for part in str(each.get_label()).split("\n"))
        ncols = int(chosen.characters / (0.83 * (longest + 9)))  # handle and gaps are 9 wide
    options |= {"handles": shown, "ncols": max(1, ncols)}
    if not is_given(axes):
        return fig.legend(**{"loc": "outside lower center"} | options)
    below = ScaledTranslation(0, -3 * chosen.font_size / 72, fig.dpi_scale_trans)
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0)}
    return axes.legend(**options | place, bbox_transform=axes.transAxes + below)


class DecadeTicks(Locator):
    """Ticks of a logarithmic axis: powers of ten, or parts of them where it has few."""

    @override
    def __call__(self) -> list[float]:
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    @override
    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        low, high = sorted((vmin, vmax))
        decades = np.log10(high / low)
        if decades < 1.0:
            return list(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
        parts = (1.0, 2.0, 5.0) if decades < 2.0 else (1.0,)
        return list(LogLocator(subs=parts, numticks=7).tick_values(low, high))


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
