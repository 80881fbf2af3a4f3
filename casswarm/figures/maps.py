"""Maps: the rates over the plane, with the guide or with a swarm on its way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..chain.trajectories import RunTrajectory
from ..planning.bounds.outlook import CostToGoMap
from ..planning.bounds.value_function import ValueFunction
from ..planning.guide import Candidate, Guide, integrate, rounded_up
from ..scenario import Scenario
from ..typing import FloatArray
from .base_map import corridor, extent, field_axes, landmarks, single_agent_map
from .style import (
    BLUE,
    INK,
    MEMBERS,
    VERMILION,
    add_legend,
    add_title,
    scaled,
    text_outline,
    themed,
    wrap_label,
)

_NEAR = 0.04  # of a map's width: graves that near share a label


@themed
def guide_map(
    scenario: Scenario, guide: Guide, others: Sequence[Candidate | FloatArray] = ()
) -> Figure:
    """The guide over the map of a lone member's rates, with its corridor.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    others : sequence of Candidate, or of paths (T+1, 2)
        Drawn thin and dashed, without the guide itself.
    """
    paths = [_path(guide, other) for other in others]
    paths = [path for path in paths if not _same(path, guide.positions)]
    fig, axes, _ = single_agent_map(scenario, [guide.positions, scenario.positions, *paths])
    for number, path in enumerate(paths):
        label = "other ways tried" if number == 0 else None
        axes.plot(*path.T, color=INK, lw=scaled(0.9), ls=(0, (4, 3)), zorder=3, label=label)
    if scenario.n > 1:
        corridor(axes, guide.positions, scenario.formation.rho)
    axes.plot(
        *guide.positions.T,
        color=BLUE,
        marker="o",
        markersize=scaled(3.2),
        linewidth=scaled(1.6),
        zorder=4,
        label=f"guide, {guide.arrival} steps",
    )
    axes.plot(
        *scenario.positions.T,
        linestyle="",
        marker="o",
        markersize=scaled(4.5),
        markerfacecolor="white",
        markeredgecolor=INK,
        markeredgewidth=scaled(1.0),
        zorder=3.5,
        label="members at the start" if scenario.n > 1 else "start",
    )
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"guide, survival of a lone member {guide.survival:.3g}")
    return fig


@themed
def comparison_map(scenario: Scenario, guides: Mapping[str, Guide]) -> Figure:
    """Several guides over the map of a lone member's rates, with what each survives."""
    fig, axes, _ = single_agent_map(scenario, [guide.positions for guide in guides.values()])
    colors = (MEMBERS[1], MEMBERS[0], *MEMBERS[2:])
    for place, (name, guide) in enumerate(guides.items()):
        axes.plot(
            *guide.positions.T,
            color=colors[place % len(colors)],
            marker="os^Dv"[place % 5],
            markersize=scaled(3.4),
            linewidth=scaled(1.6),
            zorder=4,
            label=f"{name},\nsurvival {guide.survival:.3g}",
        )
    add_legend(fig, axes)
    bounds = [g.survival_bound for g in guides.values() if g.survival_bound is not None]
    told = f"; none exceeds {rounded_up(min(bounds)):.4f}" if bounds else ""
    add_title(fig, scenario.name, f"guides of a lone member{told}")
    return fig


@themed
def cost_to_go_map(
    scenario: Scenario, value: ValueFunction | CostToGoMap, guide: Guide, step: int = 0
) -> Figure:
    """Survival from every place on at a step, along the best path there is, and its directions.

    What is drawn is what `ValueFunction.velocities` attains; limits of acceleration do not count.
    An `CostToGoMap` has its own step.
    """
    low, high = extent(scenario, [guide.positions, scenario.positions])
    outlook = value if isinstance(value, CostToGoMap) else CostToGoMap.of(value, low, high, step)
    fig, axes = field_axes(low, high)
    image = axes.imshow(
        np.where(outlook.survival > 0, outlook.survival, np.nan),
        cmap="viridis",
        norm=Normalize(0.0, 1.0),
        extent=(outlook.low[0], outlook.high[0], outlook.low[1], outlook.high[1]),
        origin="lower",
        interpolation="bilinear",
    )
    fig.colorbar(image, ax=axes, label=wrap_label("survival of a lone member from here"))
    moving = np.hypot(*outlook.velocities.T) > 0
    places, arrows = outlook.places[moving], outlook.velocities[moving]
    axes.quiver(*places.T, *arrows.T, color="white", alpha=0.75, zorder=3)
    axes.plot(*guide.positions.T, color=VERMILION, lw=scaled(1.8), zorder=4, label="guide")
    landmarks(axes, scenario, radars="white")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"the way on from every place at step {outlook.step}")
    return fig


@themed
def swarm_map(
    scenario: Scenario,
    trace: RunTrajectory,
    guide: Guide | None = None,
    title: str = "",
    corridors: bool = False,
) -> Figure:
    """The way of one run's members, with crosses and numbers where they were destroyed.

    Members often share a path: the first is drawn widest and lowest, so that all stay visible.

    Parameters
    ----------
    scenario : Scenario
    trace : Trace
    guide : Guide, optional
        Drawn dotted.
    title : str
    corridors : bool
        Whether to draw the corridor around the guide.
    """
    contents = [trace.positions.reshape(-1, 2)]
    fig, axes, _ = single_agent_map(
        scenario, contents if guide is None else [*contents, guide.positions]
    )
    members = trace.positions.shape[1]
    few = members <= len(MEMBERS)
    ends = trace.last_steps()
    for member, end in enumerate(ends):
        width = 1.3 * (members - member) if few else 0.6
        axes.plot(
            *trace.positions[: end + 1, member].T,
            color=MEMBERS[member] if few else BLUE,
            alpha=1.0 if few else 0.55,
            marker="o" if few else "",
            markersize=scaled(width + 1.0),
            linewidth=scaled(width),
            solid_capstyle="round",
            zorder=4,
            label=f"member {member + 1}" if few else ("members" if member == 0 else None),
        )
    if guide is not None:
        if corridors:
            corridor(axes, guide.positions, scenario.formation.rho)
        axes.plot(*guide.positions.T, color=INK, lw=scaled(0.9), ls=":", zorder=5, label="guide")
    _graves(axes, trace, few)
    add_legend(fig, axes)
    steps, survivors = len(trace.alive) - 1, int(trace.alive[-1].sum())
    add_title(fig, title or scenario.name, f"{survivors} of {members} alive after {steps} steps")
    return fig


def _graves(axes: Axes, trace: RunTrajectory, few: bool) -> None:
    """Crosses where members were destroyed; who, or how many, where they are many."""
    lost = np.flatnonzero(~trace.alive[-1])
    if not lost.size:
        return
    ends = trace.last_steps()
    fallen = np.array([trace.positions[ends[member], member] for member in lost])
    places, which = np.unique(np.round(fallen, 6), axis=0, return_inverse=True)
    axes.plot(
        *places.T,
        marker="X",
        markersize=scaled(9.0 if few else 6.0),
        color="white",
        markeredgecolor=INK,
        markeredgewidth=scaled(1.0),
        linestyle="",
        zorder=6,
        label="destroyed",
    )
    reach = _NEAR * float(np.ptp(axes.get_xlim())) if few else 0.0
    left = list(range(len(places)))
    while left:  # who fell close together share a label
        near = [k for k in left if np.hypot(*(places[k] - places[left[0]])) <= reach]
        left = [k for k in left if k not in near]
        place = places[near].mean(axis=0)
        here = lost[np.isin(which.reshape(-1), near)] + 1
        text = ", ".join(map(str, here)) if few else f"{len(here)}" * (len(here) > 1)
        axes.annotate(
            text,
            place,
            (scaled(6), scaled(-9)),
            textcoords="offset points",
            fontsize="small",
            path_effects=text_outline(),
            zorder=7,
        )


def _path(guide: Guide, other: Candidate | FloatArray) -> FloatArray:
    if isinstance(other, Candidate):
        return integrate(guide.positions[0], other.velocities, guide.dt)
    return other


def _same(path: FloatArray, other: FloatArray) -> bool:
    return path.shape == other.shape and bool(np.allclose(path, other, rtol=0, atol=1e-12))
