"""Maps: the rates over the plane, with the guide or with a swarm on its way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ..arrays import Floats
from ..certificate.value import ValueFunction
from ..chain.simulate import Trace
from ..guide import Candidate, Guide, path_of, rounded_up
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


def comparison_map(scenario: Scenario, guides: Mapping[str, Guide]) -> Figure:
    """Several guides over the map of a lone member's rates, with what each survives."""
    fig, axes = _map(scenario, [guide.positions for guide in guides.values()])
    for (name, guide), color in zip(guides.items(), MEMBERS[1::-1], strict=False):
        axes.plot(
            *guide.positions.T,
            color=color,
            marker="o",
            markersize=3.4,
            linewidth=1.8,
            zorder=4,
            label=f"{name}, survival {guide.survival:.3g}",
        )
    bounds = [g.survival_bound for g in guides.values() if g.survival_bound is not None]
    told = f"; none exceeds {rounded_up(min(bounds)):.4f}" if bounds else ""
    _finish(fig, axes, f"{scenario.name}: guides of a lone member{told}")
    return fig


def risk_map(scenario: Scenario, value: ValueFunction, guide: Guide, step: int = 0) -> Figure:
    """Survival from every place on at a step, along the best path there is, and its directions.

    What is drawn is what `ValueFunction.velocities` attains; limits of acceleration do not count.
    """
    contents = [guide.positions, scenario.positions, scenario.hazard.radar_positions]
    low, high = _extent(scenario, contents)
    fig, axes = _axes(low, high)
    east, north = (np.linspace(low[axis], high[axis], _PIXELS // 2) for axis in (0, 1))
    places = np.stack(np.meshgrid(east, north), axis=-1)
    survival = np.exp(-value.bounds(step, places)[1])
    image = axes.imshow(
        np.where(survival > 0, survival, np.nan),
        cmap="viridis",
        norm=Normalize(0.0, 1.0),
        extent=(low[0], high[0], low[1], high[1]),
        origin="lower",
        interpolation="bilinear",
    )
    fig.colorbar(image, ax=axes, label="survival of a lone member from here")
    coarse = places[4::9, 4::9].reshape(-1, 2)
    arrows = value.velocities(step, coarse)
    moving = np.hypot(*arrows.T) > 0
    axes.quiver(*coarse[moving].T, *arrows[moving].T, color="white", alpha=0.7, zorder=3)
    axes.plot(*guide.positions.T, color=VERMILION, linewidth=1.8, zorder=4, label="guide")
    _landmarks(axes, scenario)
    _finish(fig, axes, f"{scenario.name}: the way on from every place at step {step}")
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
    low, high = _extent(scenario, [*contents, scenario.hazard.radar_positions])
    fig, axes = _axes(low, high)
    _shades(fig, axes, scenario, low, high)
    _landmarks(axes, scenario)
    return fig, axes


def _extent(scenario: Scenario, contents: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Corners of a map that holds all `contents` and the target."""
    points = np.vstack([*contents, np.asarray(scenario.target.center)[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.06 * float(np.max(high - low)) + scenario.target.radius
    return low - pad, high + pad


def _axes(low: Floats, high: Floats) -> tuple[Figure, Axes]:
    size = high - low
    scale = _WIDTH / max(size[0], 0.9 * size[1])
    fig, axes = figure(max(4.0, scale * size[0]) + 1.2, scale * size[1] + 1.2)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")
    return fig, axes


def _landmarks(axes: Axes, scenario: Scenario) -> None:
    target, radars = scenario.target, scenario.hazard.radar_positions
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
