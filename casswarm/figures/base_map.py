"""Base map: hazard rates of an isolated agent as shades, with radars, target and corridor."""

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
from .style import INK, SKY, VERMILION, scaled, single_panel, wrap

_PIXELS = 300
_CAP = 0.995  # quantile of the rates at which the scale ends: near radars they are far higher
GREYS = LinearSegmentedColormap.from_list("greys", colormaps["Greys"](np.linspace(0.0, 0.72, 256)))


def base_map(scenario: Scenario, contents: Sequence[FloatArray]) -> tuple[Figure, Axes]:
    """Map of the hazard rates that holds all points (..., 2) of `contents`."""
    low, high = extent(scenario, contents)
    fig, axes = single_panel()
    set_extent(axes, low, high)
    norm = single_agent_norm(scenario, low, high)
    rates = scenario.hazard.single_agent_rates(pixels(low, high))
    image = draw_field(axes, np.maximum(rates, norm.vmin or 0.0), norm)
    label = wrap("single-agent hazard rate, per unit time", 0.42)
    fig.colorbar(image, ax=axes, label=label, extend="max")
    add_landmarks(axes, scenario)
    return fig, axes


def extent(scenario: Scenario, contents: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Corners of a map that holds all `contents`, the target and the radars."""
    center = np.asarray(scenario.target.center)[None]
    points = np.vstack([*contents, center, scenario.hazard.radar_positions])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.06 * float(np.max(high - low)) + scenario.target.radius
    return low - pad, high + pad


def set_extent(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Make axes a map with these corners."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")


def pixels(low: FloatArray, high: FloatArray, number: int = _PIXELS) -> FloatArray:
    """Centres (number, number, 2) of a map's pixels, row by row from the bottom."""
    size = (high - low) / number
    axis = np.arange(number) + 0.5
    return np.stack(np.meshgrid(*(low[k] + size[k] * axis for k in (0, 1))), axis=-1)


def single_agent_norm(scenario: Scenario, low: FloatArray, high: FloatArray) -> LogNorm:
    """Logarithmic scale of the hazard rates of an isolated agent between these corners."""
    rates = scenario.hazard.single_agent_rates(pixels(low, high))
    lowest = max(float(rates.min()), 1e-12)
    return LogNorm(lowest, max(float(np.quantile(rates, _CAP)), lowest * 1.01))


def draw_field(axes: Axes, values: FloatArray, norm: LogNorm) -> AxesImage:
    """Draw values at the pixels of a map as shades of grey."""
    return axes.imshow(
        values,
        norm=norm,
        cmap=GREYS,
        extent=(*axes.get_xlim(), *axes.get_ylim()),
        origin="lower",
        interpolation="bilinear",
    )


def add_landmarks(axes: Axes, scenario: Scenario, radars: str = VERMILION) -> None:
    """Draw the target and the radars."""
    zone = Circle(
        scenario.target.center,
        scenario.target.radius,
        facecolor="white",
        edgecolor=INK,
        hatch="////",
        zorder=2,
        label="target",
    )
    axes.add_patch(zone)
    if len(scenario.hazard.radar_positions):
        axes.plot(
            *scenario.hazard.radar_positions.T,
            color=radars,
            marker="^",
            markersize=scaled(9.0),
            linestyle="",
            markeredgecolor="white" if radars != "white" else INK,
            markeredgewidth=scaled(1.0),
            zorder=5,
            label="radar",
        )


def add_start(axes: Axes, positions: FloatArray, label: str = "start") -> None:
    """Draw the initial positions (n, 2) as circles."""
    axes.plot(
        *positions.T,
        linestyle="",
        marker="o",
        markersize=scaled(4.5),
        markerfacecolor="white",
        markeredgecolor=INK,
        markeredgewidth=scaled(1.0),
        zorder=5,
        label=label,
    )


def add_corridor(axes: Axes, path: FloatArray, rho: float) -> None:
    """Draw the corridor: points within the square root of `rho` of a point of the path (T, 2)."""
    pad = 1.1 * np.sqrt(rho)
    nodes = pixels(path.min(axis=0) - pad, path.max(axis=0) + pad, 2 * _PIXELS)
    nearest = np.full(nodes.shape[:2], np.inf)
    for point in path:
        np.minimum(nearest, ((nodes - point) ** 2).sum(axis=-1), out=nearest)
    east, north = nodes[0, :, 0], nodes[:, 0, 1]
    axes.contourf(east, north, nearest, [-1.0, rho], colors=SKY, alpha=0.45, zorder=2.5)
    axes.add_patch(Rectangle(path[0], 0, 0, color=SKY, alpha=0.45, linewidth=0, label="corridor"))
