"""One look for every figure: colours that the colour-blind can tell apart, sizes fit for print.

A look is a width with the sizes of letters and lines that go with it. Figures are drawn in the look
of the context, `look`, a page's unless another one is chosen, and saved at exactly that width.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec
from zlib import crc32

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.patheffects import withStroke

P = ParamSpec("P")

# M. Okabe, K. Ito, Color Universal Design, 2002, revised 2008, https://jfly.uni-koeln.de/color/
INK = "#222222"
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"  # not theirs, nor is INK
MEMBERS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION)

DPI = 200


@dataclass(frozen=True)
class Theme:
    """Width in inches, letters in points, lines as a factor of a page's, and height over width."""

    width: float
    letters: float
    lines: float
    shape: float


THEMES = {
    "column": Theme(3.5, 8.0, 0.8, 0.72),
    "page": Theme(7.16, 9.0, 1.0, 0.46),
    "slide": Theme(10.0, 16.0, 1.7, 0.52),
}
"""A column and a double column of a journal (those of the IEEE), and a slide."""

_CURRENT: ContextVar[str] = ContextVar("look", default="page")


@contextmanager
def theme(name: str) -> Iterator[None]:
    """Draw figures in the look of this name, of `THEMES`, while in the context.

    Raises
    ------
    ValueError
        An unknown name.
    """
    if name not in THEMES:
        raise ValueError(f"theme {name!r} is unknown; allowed: {', '.join(THEMES)}")
    token = _CURRENT.set(name)
    try:
        yield
    finally:
        _CURRENT.reset(token)


def current_theme() -> Theme:
    """The look of the context."""
    return THEMES[_CURRENT.get()]


def themed(function: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, with the letters and lines of the look of its context.

    What is drawn comes out as it is, whatever the user's own settings of matplotlib are, and as
    high as it has to be.
    """

    @wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context(settings(current_theme())):
            fig = function(*args, **kwargs)
            _fix_ticks(axes for axes in fig.axes if axes.get_subplotspec() is None)  # scales
            fit_height(fig)
        return fig

    return draw


def settings(chosen: Theme) -> dict[Any, Any]:
    """Matplotlib's settings of a look."""
    thin = 0.8 * chosen.lines
    return {
        "font.family": "DejaVu Sans",  # comes with matplotlib, so that all machines draw the same
        "font.size": chosen.letters,
        "axes.titlesize": "medium",
        "axes.labelsize": "medium",
        "figure.titlesize": "medium",
        "xtick.labelsize": "small",
        "ytick.labelsize": "small",
        "legend.fontsize": "small",
        "legend.frameon": False,
        "legend.handlelength": 2.4,
        "lines.linewidth": 1.5 * chosen.lines,
        "lines.markersize": 4.5 * chosen.lines,
        "errorbar.capsize": 3.0 * chosen.lines,
        "patch.linewidth": thin,
        "hatch.linewidth": thin,
        "grid.linewidth": 0.75 * thin,
        "axes.linewidth": thin,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
    } | {
        f"{axis}tick.{kind}.{what}": value * chosen.lines
        for axis in "xy"
        for kind, what, value in (
            ("major", "width", 0.8),
            ("minor", "width", 0.6),
            ("major", "size", 3.5),
            ("minor", "size", 2.0),
        )
    }


def scaled(factor: float = 1.0) -> float:
    """A line's width, or a marker's size, in points: on a page `factor`."""
    return factor * current_theme().lines


def figure(shape: float | None = None) -> tuple[Figure, Axes]:
    """A figure of one axes, `shape` its height over its width; without pyplot's global state."""
    fig, axes = panels(1, 1, shape)
    return fig, axes[0]


def panels(
    columns: int, rows: int, shape: float | None = None, **options: Any
) -> tuple[Figure, list[Axes]]:
    """A figure of rows times columns axes, row by row; `options` are those of `subplots`."""
    width = current_theme().width
    height = width * (current_theme().shape if shape is None else shape)
    fig = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(fig)
    axes = list(fig.subplots(rows, columns, squeeze=False, **options).ravel())
    _fix_ticks(axes)
    return fig, axes


def _fix_ticks(some: Iterable[Axes]) -> None:
    """Give numbers along axes their size in points.

    How many fit is asked again when a figure is written, when the look's settings hold no more.
    """
    for axes in some:
        axes.tick_params(which="both", labelsize=FontProperties(size="small").get_size_in_points())


def add_title(fig: Figure, *parts: str) -> None:
    """The title of a figure: its parts, those that are not empty, broken to the figure's width."""
    chosen = current_theme()
    most = int(72 * chosen.width / (0.56 * chosen.letters))
    text = ": ".join(part for part in parts if part)
    if text:
        fig.suptitle(textwrap.fill(text, most))


def wrap_label(label: str) -> str:
    """A label along a map's side, broken so that it fits there."""
    chosen = current_theme()
    return textwrap.fill(label, int(0.42 * 72 * chosen.width / (0.56 * chosen.letters)))


def add_legend(fig: Figure, axes: Axes) -> Legend:
    """The legend of a map: on the right of a wide figure, below a narrow one."""
    handles, labels = axes.get_legend_handles_labels()
    chosen = current_theme()
    if chosen.width > 5:
        return fig.legend(handles, labels, loc="outside right center", borderpad=1.0)
    longest = max(len(part) for label in labels for part in label.split("\n"))
    letters = 0.58 * longest + 5.4  # widths of an M, of which sign and gaps take the latter
    fitting = int(chosen.width / (letters * 0.83 * chosen.letters / 72))
    return fig.legend(handles, labels, loc="outside lower center", ncols=max(1, fitting))


def text_outline() -> list[withStroke]:
    """What makes small words readable on any ground."""
    return [withStroke(linewidth=scaled(1.8), foreground="white", alpha=0.85)]


def despine(axes: Axes) -> None:
    """Plain frame and quiet grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#dddddd")
    axes.set_axisbelow(True)


@dataclass(frozen=True)
class PolicyStyle:
    """How a policy is drawn: told apart without colours too."""

    color: str
    dashes: Any
    marker: str


POLICIES = {
    "naive": PolicyStyle(VERMILION, "-", "o"),
    "constrained": PolicyStyle(GREEN, (0, (5, 1.5)), "s"),
    "leader": PolicyStyle(BLUE, (0, (6, 1.5, 1, 1.5)), "D"),
    "constrained-feedback": PolicyStyle(ORANGE, (0, (3, 1)), "^"),
    "leader-feedback": PolicyStyle(SKY, (0, (2, 1, 1, 1)), "v"),
    "joint": PolicyStyle(PURPLE, (0, (1, 1)), "P"),
    "joint-replanning": PolicyStyle(
        "#882255", (0, (4, 1, 1, 1)), "p"
    ),  # the last three: darker kin
    "constrained-mpc": PolicyStyle("#00573F", (0, (8, 1.5, 1, 1.5)), "d"),
    "leader-mpc": PolicyStyle("#003B6F", (0, (3, 1, 1, 1, 1, 1)), "*"),
}
"""The policies that casswarm brings; the same in every figure. Theme-ahead of any length is one."""

_OTHERS = (
    PolicyStyle(INK, (0, (8, 2)), "X"),
    PolicyStyle(GREY, (0, (4, 1, 1, 1, 1, 1)), "h"),
    PolicyStyle("#7A5195", (0, (1, 2)), "<"),
    PolicyStyle("#8B5A2B", (0, (10, 2, 2, 2)), ">"),
)


def policy_styles(names: Iterable[str]) -> dict[str, PolicyStyle]:
    """How every policy of these names is drawn; others by their name, and no two alike.

    More policies than there are marks share them.
    """
    found: dict[str, PolicyStyle] = {}
    for name in dict.fromkeys(map(str, names)):
        first = crc32(name.encode()) % len(_OTHERS)
        order = [_OTHERS[(first + k) % len(_OTHERS)] for k in range(len(_OTHERS))]
        free = [mark for mark in order if mark not in found.values()]
        known = POLICIES.get(re.sub(r"-mpc-\d+$", "-mpc", name))
        found[name] = known if known and known not in found.values() else (free or order)[0]
    return found


def format_value(value: object) -> str:
    """A parameter's value as an axis tells it."""
    number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return f"{value:g}" if number else str(value)


def fit_height(fig: Figure) -> None:
    """Make a figure as high as maps need it to be to use its width, and lay it out for good."""
    maps = [a for a in fig.axes if a.get_aspect() != "auto" and a.get_subplotspec() is not None]
    engine = fig.get_layout_engine()
    if not maps or engine is None:
        return
    for axes in maps:  # the layout of axes that shrink in their boxes may swing
        axes.set_aspect("auto")
    engine.execute(fig)
    for _ in range(5):
        missing = _missing_height(fig, maps[0])
        if abs(missing) < 0.01:
            break
        width, height = fig.get_size_inches()
        fig.set_size_inches(width, max(0.3 * width, height + missing))
        engine.execute(fig)
    fig.set_layout_engine("none")
    for axes in maps:
        axes.set_aspect("equal")


def _missing_height(fig: Figure, axes: Axes) -> float:
    """Inches by which a figure is too low (below zero: too high) for its rows of such maps."""
    spec = axes.get_subplotspec()
    assert spec is not None
    wide, high = fig.get_size_inches() * axes.get_position().size
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return float(spec.get_gridspec().nrows * (wide * (north - south) / (east - west) - high))


def save(fig: Figure, path: Path | str, dpi: int = DPI) -> Path:
    """Write a figure at its own width; the file's ending names the format (png, pdf, svg, ...).

    The same figure gives the same file, byte for byte: nothing tells when it was written.
    """
    path = Path(path)
    ending = path.suffix.lower()
    dates = {".pdf": "CreationDate", ".svg": "Date"}
    metadata = {dates[ending]: None} if ending in dates else None
    # text as text, which journals ask for; names in an SVG that do not change
    with rc_context({"pdf.fonttype": 42, "svg.hashsalt": "casswarm"}):
        fig.savefig(path, dpi=dpi, metadata=metadata)
    return path
