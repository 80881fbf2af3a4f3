"""The layout of figures with maps: as high as the maps need, with room for all that is written."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure


def settle(fig: Figure) -> None:
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
