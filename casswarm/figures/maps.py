"""Maps: the rates over the plane, with the guide or with a swarm on its way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ..chain.simulate import Trace
from ..guide import Candidate, Guide
from ..scenario import Scenario
from .style import INK, MEMBERS, VERMILION, figure

Floats = NDArray[np.float64]

_PIXELS = 240
_CAP = 0.995  # quantile of the rates at which the colours end: radars are not the whole story
_HALO = [withStroke(linewidth=3.0, foreground="white")]


def guide_map(scenario: Scenario, guide: Guide, others: Sequence[Candidate] = ()) -> Figure:
    """The guide over the map of a lone member's rates; `others` are drawn thin and dashed."""
    from ..guide import path_of

    paths = [path_of(guide.positions[0], c.velocities, guide.dt) for c in others]
    fig, axes = figure(7.2, 5.4)
    draw_rates(fig, axes, scenario, [guide.positions, scenario.positions, *paths])
    for number, path in enumerate(paths):
        axes.plot(
            *path.T,
            color=INK,
            linewidth=0.9,
            linestyle=(0, (4, 3)),
            zorder=3,
            label="other ways tried" if number == 0 else None,
        )
    axes.plot(
        *guide.positions.T,
        color=MEMBERS[0],
        marker="o",
        markersize=3.2,
        linewidth=1.8,
        zorder=4,
        path_effects=_HALO,
        label=f"guide, a dot a step ({guide.arrival} steps)",
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
    _legend(axes)
    axes.set_title(f"{scenario.name}: guide, survival of a lone member {guide.survival:.3g}")
    return fig


def swarm_map(
    scenario: Scenario, trace: Trace, guide: Guide | None = None, title: str = ""
) -> Figure:
    """The way of one run's members, with crosses where they were destroyed."""
    fig, axes = figure(7.2, 5.4)
    extent = [trace.positions.reshape(-1, 2)]
    draw_rates(fig, axes, scenario, extent if guide is None else [*extent, guide.positions])
    if guide is not None:
        axes.plot(
            *guide.positions.T, color=INK, linewidth=1.0, linestyle=":", label="guide", zorder=3
        )
    many = trace.positions.shape[1] > len(MEMBERS)
    lost = 0
    for member in range(trace.positions.shape[1]):
        alive = trace.alive[:, member]
        last = len(alive) if alive.all() else int(np.argmin(alive)) + 1
        color = MEMBERS[member % len(MEMBERS)]
        path = trace.positions[:last, member]
        axes.plot(
            *path.T,
            color=color,
            marker="o",
            markersize=1.8 if many else 2.6,
            linewidth=0.8 if many else 1.3,
            zorder=4,
            path_effects=None if many else _HALO,
            label=None if many else f"member {member + 1}",
        )
        if not alive.all():
            lost += 1
            axes.plot(
                *path[-1],
                marker="X",
                markersize=9,
                color=VERMILION,
                markeredgecolor="white",
                linestyle="",
                zorder=6,
                label="destroyed" if lost == 1 else None,
            )
    _legend(axes)
    survivors = int(trace.alive[-1].sum())
    head = title or scenario.name
    axes.set_title(
        f"{head}: {survivors} of {trace.alive.shape[1]} alive after {len(trace.alive) - 1} steps"
    )
    return fig


def draw_rates(fig: Figure, axes: Axes, scenario: Scenario, contents: Sequence[Floats]) -> None:
    """Rates of a lone member as colours, radars, target; the extent holds all `contents`."""
    hazard, target = scenario.hazard, scenario.target
    points = np.vstack([*contents, hazard.radar_positions, np.asarray(target.center)[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.12 * max(high - low) + target.radius
    low, high = low - pad, high + pad
    east, north = (np.linspace(low[axis], high[axis], _PIXELS) for axis in (0, 1))
    rates = hazard.lone_rates(np.stack(np.meshgrid(east, north), axis=-1))
    least = max(float(rates.min()), 1e-12)
    most = max(float(np.quantile(rates, _CAP)), least * 1.01)
    mesh = axes.pcolormesh(
        east,
        north,
        np.maximum(rates, least),
        norm=LogNorm(least, most),
        cmap="cividis",
        shading="gouraud",
        rasterized=True,
        alpha=0.85,
    )
    fig.colorbar(mesh, ax=axes, label="rate of a lone member, per unit time", extend="max")
    axes.add_patch(
        Circle(target.center, target.radius, fill=False, edgecolor="white", linewidth=3.0, zorder=3)
    )
    axes.add_patch(
        Circle(
            target.center,
            target.radius,
            facecolor="none",
            edgecolor=INK,
            linewidth=1.4,
            hatch="////",
            zorder=3,
            label="target",
        )
    )
    if len(hazard.radar_positions):
        axes.plot(
            *hazard.radar_positions.T,
            linestyle="",
            marker="^",
            markersize=9,
            color=VERMILION,
            markeredgecolor="white",
            zorder=5,
            label="radar",
        )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")


def _legend(axes: Axes) -> None:
    axes.legend(loc="upper left", fontsize=8, framealpha=0.92, edgecolor="none")
