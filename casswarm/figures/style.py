"""One look for every figure: colours that the colour-blind can tell apart, sizes fit for print."""

from __future__ import annotations

from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# Okabe, Ito, Color Universal Design, 2008
INK = "#222222"
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
MEMBERS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION)
POLICIES = {
    "naive": VERMILION,
    "constrained": GREEN,
    "leader": BLUE,
    "constrained-feedback": ORANGE,
    "leader-feedback": SKY,
}

DPI = 200


def figure(width: float = 6.4, height: float = 4.8) -> tuple[Figure, Axes]:
    """A figure of one axes, in inches; drawn without pyplot, so without global state."""
    fig = Figure(figsize=(width, height), layout="compressed")
    FigureCanvasAgg(fig)
    return fig, fig.add_subplot()


def panels(columns: int, rows: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """A figure of rows times columns axes, each of a width and height in inches; row by row."""
    fig = Figure(figsize=(columns * width, rows * height), layout="constrained")
    FigureCanvasAgg(fig)
    return fig, list(fig.subplots(rows, columns, squeeze=False).ravel())


def tidy(axes: Axes) -> None:
    """Plain frame and quiet grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def save(fig: Figure, path: Path) -> Path:
    """Write a figure; the file's ending names the format (png, pdf, svg, ...)."""
    with rc_context({"pdf.fonttype": 42}):  # text as text, which journals ask for
        fig.savefig(path, dpi=DPI, bbox_inches="tight")
    return path
