"""The ground of maps: rates of a lone member as shades, radars, target and corridor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Rectangle

from ..scenario import Scenario
from ..typing import FloatArray
from .style import INK, SKY, VERMILION, figure, scaled, wrap_label

_PIXELS = 300
_CAP = 0.995  # quantile of the rates at which the shades end: radars are not the whole story
GREYS = LinearSegmentedColormap.from_list("greys", colormaps["Greys"](np.linspace(0.0, 0.72, 256)))


def single_agent_map(
    scenario: Scenario, contents: Sequence[FloatArray]
) -> tuple[Figure, Axes, AxesImage]:
    """Rates of a lone member as shades, radars and target; the extent holds all `contents`."""
    low, high = extent(scenario, contents)
    fig, axes = field_axes(low, high)
    image = draw_rates(axes, scenario)
    label = wrap_label("rate of a lone member, per unit time")
    fig.colorbar(image, ax=axes, label=label, extend="max")
    landmarks(axes, scenario)
    return fig, axes, image


def extent(scenario: Scenario, contents: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Corners of a map that holds all `contents`, the target and the radars."""
    center = np.asarray(scenario.target.center)[None]
    points = np.vstack([*contents, center, scenario.hazard.radar_positions])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.06 * float(np.max(high - low)) + scenario.target.radius
    return low - pad, high + pad


def field_axes(low: FloatArray, high: FloatArray) -> tuple[Figure, Axes]:
    """A figure with a map of these corners."""
    fig, axes = figure()
    frame(axes, low, high)
    return fig, axes


def frame(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Make axes a map of these corners."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")


def landmarks(axes: Axes, scenario: Scenario, radars: str = VERMILION) -> None:
    """Target and radars."""
    target, places = scenario.target, scenario.hazard.radar_positions
    zone = Circle(
        target.center,
        target.radius,
        facecolor="white",
        edgecolor=INK,
        hatch="////",
        zorder=2,
        label="target",
    )
    axes.add_patch(zone)
    if len(places):
        axes.plot(
            *places.T,
            color=radars,
            marker="^",
            markersize=scaled(9.0),
            linestyle="",
            markeredgecolor="white" if radars != "white" else INK,
            markeredgewidth=scaled(1.0),
            zorder=5,
            label="radar",
        )


def pixels(low: FloatArray, high: FloatArray, number: int = _PIXELS) -> FloatArray:
    """Centres (number, number, 2) of a map's pixels, row by row from below."""
    size = (high - low) / number
    axis = np.arange(number) + 0.5
    return np.stack(np.meshgrid(*(low[k] + size[k] * axis for k in (0, 1))), axis=-1)


def corners(axes: Axes) -> tuple[FloatArray, FloatArray]:
    """Corners of a map."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return np.array([west, south]), np.array([east, north])


def single_agent_norm(scenario: Scenario, low: FloatArray, high: FloatArray) -> LogNorm:
    """Shades of the rates of a lone member between these corners; radars end them."""
    rates = scenario.hazard.single_agent_rates(pixels(low, high))
    least = max(float(rates.min()), 1e-12)
    return LogNorm(least, max(float(np.quantile(rates, _CAP)), least * 1.01))


def draw_rates(axes: Axes, scenario: Scenario) -> AxesImage:
    """The rates of a lone member over a map."""
    low, high = corners(axes)
    norm = single_agent_norm(scenario, low, high)
    return axes.imshow(
        np.maximum(scenario.hazard.single_agent_rates(pixels(low, high)), norm.vmin or 0.0),
        norm=norm,
        cmap=GREYS,
        extent=(low[0], high[0], low[1], high[1]),
        origin="lower",
        interpolation="bilinear",
    )


def corridor(axes: Axes, places: FloatArray, rho: float) -> None:
    """The places within the root of `rho` of one of `places` (T, 2)."""
    pad = 1.1 * np.sqrt(rho)
    low, high = places.min(axis=0) - pad, places.max(axis=0) + pad
    nodes = pixels(low, high, 2 * _PIXELS)
    nearest = np.full(nodes.shape[:2], np.inf)
    for place in places:
        np.minimum(nearest, ((nodes - place) ** 2).sum(axis=-1), out=nearest)
    east, north = nodes[0, :, 0], nodes[:, 0, 1]
    axes.contourf(east, north, nearest, [-1.0, rho], colors=SKY, alpha=0.45, zorder=2.5)
    axes.add_patch(Rectangle(places[0], 0, 0, color=SKY, alpha=0.45, linewidth=0, label="corridor"))
