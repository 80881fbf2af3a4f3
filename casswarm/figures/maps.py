"""Maps: the rates over the plane, with the guide or with a swarm on its way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ..arrays import Floats
from ..chain.simulate import Trace
from ..guide import Candidate, Guide, path_of
from ..scenario import Scenario
from .style import BLUE, INK, MEMBERS, VERMILION, figure

_PIXELS = 300
_CAP = 0.995  # quantile of the rates at which the shades end: radars are not the whole story
_WIDTH = 6.6  # of the map without its colour bar, inches
_GREYS = LinearSegmentedColormap.from_list("greys", colormaps["Greys"](np.linspace(0.0, 0.72, 256)))


def guide_map(scenario: Scenario, guide: Guide, others: Sequence[Candidate] = ()) -> Figure:
    """The guide over the map of a lone member's rates.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    others : sequence of Candidate
        Drawn thin and dashed, without the guide itself.
    """
    others = [candidate for candidate in others if candidate.solution is not guide.solution]
    paths = [path_of(guide.positions[0], c.velocities, guide.dt) for c in others]
    fig, axes = _map(scenario, [guide.positions, scenario.positions, *paths])
    for number, path in enumerate(paths):
        label = "other ways tried" if number == 0 else None
        axes.plot(*path.T, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=3, label=label)
    axes.plot(
        *guide.positions.T,
        color=BLUE,
        marker="o",
        markersize=3.4,
        linewidth=1.8,
        zorder=4,
        label=f"guide, {guide.arrival} steps",
    )
    axes.plot(
        *scenario.positions.T,
        linestyle="",
        marker="o",
        markersize=4.5,
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=3.5,
        label="members at the start",
    )
    _finish(fig, axes, f"{scenario.name}: guide, survival of a lone member {guide.survival:.3g}")
    return fig


def swarm_map(
    scenario: Scenario, trace: Trace, guide: Guide | None = None, title: str = ""
) -> Figure:
    """The way of one run's members, with crosses where they were destroyed.

    Members often share a path: the first is drawn widest and lowest, so that all stay visible.
    """
    contents = [trace.positions.reshape(-1, 2)]
    fig, axes = _map(scenario, contents if guide is None else [*contents, guide.positions])
    members = trace.positions.shape[1]
    few = members <= len(MEMBERS)
    fallen = []
    for member in range(members):
        alive = trace.alive[:, member]
        last = len(alive) if alive.all() else int(np.argmin(alive)) + 1
        path = trace.positions[:last, member]
        width = 1.4 * (members - member) if few else 0.8
        axes.plot(
            *path.T,
            color=MEMBERS[member % len(MEMBERS)],
            marker="o",
            markersize=width + 1.2,
            linewidth=width,
            solid_capstyle="round",
            zorder=4,
            label=f"member {member + 1}" if few else None,
        )
        if not alive.all():
            fallen.append(path[-1])
    if guide is not None:
        axes.plot(*guide.positions.T, color=INK, linewidth=0.9, ls=":", zorder=5, label="guide")
    if fallen:
        places, counts = np.unique(np.round(fallen, 6), axis=0, return_counts=True)
        axes.plot(
            *places.T,
            marker="X",
            markersize=11,
            color="white",
            markeredgecolor=INK,
            linestyle="",
            zorder=6,
            label="destroyed",
        )
        for place, count in zip(places[counts > 1], counts[counts > 1], strict=True):
            axes.annotate(f"{count}", place, (7, 5), textcoords="offset points", zorder=7)
    steps, survivors = len(trace.alive) - 1, int(trace.alive[-1].sum())
    _finish(
        fig,
        axes,
        f"{title or scenario.name}: {survivors} of {members} alive after {steps} steps",
    )
    return fig


def _map(scenario: Scenario, contents: Sequence[Floats]) -> tuple[Figure, Axes]:
    """Rates of a lone member as shades, radars and target; the extent holds all `contents`."""
    hazard, target = scenario.hazard, scenario.target
    radars = hazard.radar_positions
    points = np.vstack([*contents, radars, np.asarray(target.center)[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.06 * float(np.max(high - low)) + target.radius
    low, high = low - pad, high + pad
    size = high - low
    scale = _WIDTH / max(size[0], 0.9 * size[1])
    fig, axes = figure(max(4.0, scale * size[0]) + 1.2, scale * size[1] + 1.2)
    _shades(fig, axes, scenario, low, high)
    axes.add_patch(
        Circle(
            target.center,
            target.radius,
            facecolor="white",
            edgecolor=INK,
            linewidth=1.3,
            hatch="////",
            zorder=2,
            label="target",
        )
    )
    if len(radars):
        axes.plot(
            *radars.T,
            color=VERMILION,
            marker="^",
            markersize=10,
            linestyle="",
            markeredgecolor="white",
            zorder=5,
            label="radar",
        )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")
    return fig, axes


def _shades(fig: Figure, axes: Axes, scenario: Scenario, low: Floats, high: Floats) -> None:
    east, north = (np.linspace(low[axis], high[axis], _PIXELS) for axis in (0, 1))
    rates = scenario.hazard.lone_rates(np.stack(np.meshgrid(east, north), axis=-1))
    least = max(float(rates.min()), 1e-12)
    most = max(float(np.quantile(rates, _CAP)), least * 1.01)
    image = axes.imshow(
        np.maximum(rates, least),
        norm=LogNorm(least, most),
        cmap=_GREYS,
        extent=(low[0], high[0], low[1], high[1]),
        origin="lower",
        interpolation="bilinear",
    )
    fig.colorbar(image, ax=axes, label="rate of a lone member, per unit time", extend="max")


def _finish(fig: Figure, axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=11)
    handles, labels = axes.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
