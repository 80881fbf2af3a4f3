"""Base map: hazard rates as shades, with radars, target, corridor, and labels of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from .._util.figure_style import (
    INK,
    SKY,
    VERMILION,
    current_theme,
    marker,
    scaled,
    single_panel,
    wrap,
)
from ..scenario import Scenario
from ..typing import FloatArray

_OFFSET = 10.0  # points on a page from a point to the middle of its label
_MAP = 0.62  # about the width of a map, as a fraction of its figure's


class LabelPlaces:
    """Places that labels leave free on a map.

    Parameters
    ----------
    scenario : Scenario
    paths : sequence of (..., 2)
        Points that labels avoid, besides radars and target.
    width : float
        Of the map, in its own units.
    """

    def __init__(self, scenario: Scenario, paths: Sequence[FloatArray], width: float) -> None:
        self.distance = width * scaled(_OFFSET) / (72 * _MAP * current_theme().width)
        radars = scenario.hazard.radar_positions.reshape(-1, 2)
        points = np.vstack([path.reshape(-1, 2) for path in paths])
        self.centers = np.vstack([points, radars, np.asarray(scenario.target.center)[None]])
        self.radii = np.zeros(len(self.centers))
        self.radii[len(points) :] = 0.8 * self.distance
        self.radii[-1] += scenario.target.radius

    def add(self, axes: Axes, text: str, point: FloatArray) -> None:
        """Write a label beside a point (2,)."""
        direction = self.clearest_direction(point)
        self.centers = np.vstack([self.centers, point + self.distance * direction])
        self.radii = np.append(self.radii, 0.8 * self.distance)
        offset = (_OFFSET * float(direction[0]), _OFFSET * float(direction[1]))
        add_label(axes, text, point, offset, outlined=True, ha="center", va="center", zorder=7)

    def clearest_direction(self, point: FloatArray) -> FloatArray:
        """Direction (2,) from a point in which a label is farthest from what it avoids."""
        angles = np.pi / 4 * np.array([7, 5, 1, 3, 6, 2, 0, 4])  # of equals the first is taken
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        offsets = (point + self.distance * directions)[:, None] - self.centers
        gaps = (np.linalg.norm(offsets, axis=2) - self.radii).min(axis=1)
        return np.asarray(directions[int(np.argmax(gaps.round(9)))])


def add_label(
    axes: Axes,
    text: str,
    point: Any,
    offset: tuple[float, float],
    outlined: bool = False,
    **options: Any,
) -> Annotation:
    """Write small text at an offset, in points on a page, from a point.

    An outline makes it readable on any background. `options` are those of ``Axes.annotate``.
    """
    if outlined:
        outline = withStroke(linewidth=scaled(1.8), foreground="white", alpha=0.85)
        options["path_effects"] = [outline]
    place = (scaled(offset[0]), scaled(offset[1]))
    return axes.annotate(
        text, point, place, textcoords="offset points", fontsize="small", **options
    )


_PIXELS = 300
_CORRIDOR_POINTS = 1000  # at most, of a path whose corridor is drawn: bounds time
_CAP = 0.995  # quantile of the rates at which the scale ends: near radars they are far higher
GREYS = LinearSegmentedColormap.from_list("greys", colormaps["Greys"](np.linspace(0.0, 0.72, 256)))


def base_map(scenario: Scenario, contents: Sequence[FloatArray]) -> tuple[Figure, Axes]:
    """Figure with a map of the hazard rates that holds all points (..., 2) of `contents`."""
    fig, axes = single_panel()
    image = draw_base_map(axes, scenario, *scenario.extent(contents))
    add_colorbar(axes, image, "single-agent hazard rate, per unit time", extend="max")
    return fig, axes


def add_colorbar(axes: Axes, image: AxesImage, label: str, **options: Any) -> None:
    """Add a colorbar beside a map, as high as it; `options` are those of ``Figure.colorbar``."""
    fig = axes.get_figure(root=True)
    assert fig is not None
    beside = axes.inset_axes((1.05, 0.0, 0.03, 1.0))
    fig.colorbar(image, cax=beside, label=wrap(label, 0.42), **options)


def set_extent(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Make axes a map with these corners."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")


def pixels(low: FloatArray, high: FloatArray, number: int = _PIXELS) -> FloatArray:
    """Centres (number, number, 2) of a map's pixels, row by row from the bottom."""
    size = (high - low) / number
    axis = np.arange(number) + 0.5
    return np.stack(np.meshgrid(*(low[k] + size[k] * axis for k in (0, 1))), axis=-1)


def draw_base_map(axes: Axes, scenario: Scenario, low: FloatArray, high: FloatArray) -> AxesImage:
    """Make axes a map with these corners: hazard rates on a logarithmic scale, and landmarks."""
    set_extent(axes, low, high)
    rates = scenario.hazard.single_agent_rates(pixels(low, high))
    lowest = max(float(rates.min()), 1e-12 * float(rates.max())) or 1.0  # all rates may be zero
    norm = LogNorm(lowest, max(float(np.quantile(rates, _CAP)), lowest * 1.01))
    add_landmarks(axes, scenario)
    return draw_field(axes, np.maximum(rates, lowest), norm)


def draw_field(
    axes: Axes, values: FloatArray, norm: Normalize, cmap: Colormap | str = GREYS
) -> AxesImage:
    """Draw values at the pixels of a map."""
    return axes.imshow(
        values,
        norm=norm,
        cmap=cmap,
        extent=(*axes.get_xlim(), *axes.get_ylim()),
        origin="lower",
        interpolation="bilinear",
    )


def add_landmarks(axes: Axes, scenario: Scenario, radars: str = VERMILION) -> None:
    """Draw the target and the radars."""
    center, radius = scenario.target.center, scenario.target.radius
    zone = Circle(center, radius, facecolor="white", edgecolor=INK, hatch="////", label="target")
    axes.add_patch(zone).set_zorder(2)
    if len(scenario.hazard.radar_positions):
        style = marker("^", 9, radars, edge="white" if radars != "white" else INK)
        axes.plot(*scenario.hazard.radar_positions.T, zorder=5, label="radar", **style)


def add_start(axes: Axes, positions: FloatArray, label: str = "start") -> None:
    """Draw the initial positions (n, 2) as circles."""
    axes.plot(*positions.T, zorder=5, label=label, **marker("o", 4.5))


def add_corridor(axes: Axes, path: FloatArray, rho: float) -> None:
    """Draw the corridor: points within the square root of `rho` of a point of the path (T, 2)."""
    pad = 1.1 * np.sqrt(rho)
    nodes = pixels(path.min(axis=0) - pad, path.max(axis=0) + pad, 2 * _PIXELS)
    nearest = np.full(nodes.shape[:2], np.inf)
    shown = np.linspace(0, len(path) - 1, min(len(path), _CORRIDOR_POINTS)).round().astype(int)
    for point in path[shown]:
        np.minimum(nearest, ((nodes - point) ** 2).sum(axis=-1), out=nearest)
    east, north = nodes[0, :, 0], nodes[:, 0, 1]
    axes.contourf(east, north, nearest, [-1.0, rho], colors=SKY, alpha=0.45, zorder=2.5)
    axes.add_patch(Rectangle(path[0], 0, 0, color=SKY, alpha=0.45, linewidth=0, label="corridor"))
