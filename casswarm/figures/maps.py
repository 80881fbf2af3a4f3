"""Maps of guides, of the runs of a swarm and of joint plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from .._util.text import counted
from ..chain.trajectories import RunTrajectory
from ..planning.bounds import CostToGoMap, ValueFunction
from ..planning.guide import Candidate, Guide, rounded_up
from ..planning.kinematics import integrate
from ..scenario import Scenario
from ..typing import FloatArray
from .base_map import (
    add_corridor,
    add_landmarks,
    add_start,
    base_map,
    draw_field,
    extent,
    set_extent,
)
from .style import (
    BLUE,
    INK,
    MEMBERS,
    VERMILION,
    add_label,
    add_legend,
    add_title,
    marker,
    scaled,
    single_panel,
    themed,
    wrap,
)

_THINNEST = 0.3  # width of a path where its member is certainly dead
_NEAR = 0.04  # of a map's width: loss markers this close share a label


@themed
def guide_map(
    scenario: Scenario, guide: Guide, others: Sequence[Candidate | FloatArray] = ()
) -> Figure:
    """Guide with its corridor on the hazard rates of an isolated agent.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    others : sequence of Candidate, or of paths (T+1, 2)
        Drawn thin and dashed; the guide itself among them is left out.
    """
    paths = [
        integrate(guide.positions[0], other.velocities, guide.dt)
        if isinstance(other, Candidate)
        else other
        for other in others
    ]
    shape, tie = guide.positions.shape, 1e-12 * np.abs(guide.positions).max()
    paths = [p for p in paths if p.shape != shape or np.abs(p - guide.positions).max() > tie]
    fig, axes = base_map(scenario, [guide.positions, scenario.positions, *paths])
    for number, path in enumerate(paths):
        label = "other candidate paths" if number == 0 else None
        axes.plot(*path.T, color=INK, lw=scaled(0.9), ls=(0, (4, 3)), zorder=3, label=label)
    if scenario.n > 1:
        add_corridor(axes, guide.positions, scenario.formation.rho)
    (line,) = axes.plot(*guide.positions.T, color=BLUE, marker="o", zorder=4)
    line.set(markersize=scaled(3.2), linewidth=scaled(1.6))
    line.set_label(f"guide, {counted(guide.arrival, 'step')}")
    add_start(axes, scenario.positions, "initial positions" if scenario.n > 1 else "start")
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"guide, single-agent survival {guide.survival:.3g}")
    return fig


@themed
def cost_to_go_map(
    scenario: Scenario, value: ValueFunction | CostToGoMap, guide: Guide, step: int = 0
) -> Figure:
    """Survival to go at a step: that of the optimal path from every position, and its direction.

    Limits of acceleration are neglected, as by `ValueFunction.velocities`. A `CostToGoMap` has its
    own step.
    """
    low, high = extent(scenario, [guide.positions, scenario.positions])
    costs = (
        value
        if isinstance(value, CostToGoMap)
        else CostToGoMap.from_value_function(value, low, high, step)
    )
    fig, axes = single_panel()
    set_extent(axes, low, high)
    survival = np.where(costs.survival > 0, costs.survival, np.nan)
    image = draw_field(axes, survival, Normalize(0.0, 1.0), "viridis")
    image.set_extent((costs.low[0], costs.high[0], costs.low[1], costs.high[1]))
    fig.colorbar(image, ax=axes, label=wrap("single-agent survival from here", 0.42))
    moving = np.hypot(*costs.velocities.T) > 0
    starts, arrows = costs.positions[moving], costs.velocities[moving]
    axes.quiver(*starts.T, *arrows.T, color="white", alpha=0.75, zorder=3)
    axes.plot(*guide.positions.T, color=VERMILION, lw=scaled(1.8), zorder=4, label="guide")
    add_landmarks(axes, scenario, radars="white")
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"optimal direction at step {costs.step}")
    return fig


@themed
def comparison_map(scenario: Scenario, guides: Mapping[str, Guide], title: str = "") -> Figure:
    """Several guides with their single-agent survival and arrival, by name.

    The title is by default the best known upper bound on survival.
    """
    labels = [
        f"{name},\nsurvival {guide.survival:.3g}, {counted(guide.arrival, 'step')}"
        for name, guide in guides.items()
    ]
    paths = [guide.positions for guide in guides.values()]
    fig, axes = _paths_map(scenario, paths, labels)
    add_start(axes, np.unique([path[0] for path in paths], axis=0))
    add_legend(fig, axes)
    bounds = [g.survival_bound for g in guides.values() if g.survival_bound is not None]
    bound = f"; upper bound {rounded_up(min(bounds)):.4f}" if bounds else ""
    add_title(fig, scenario.name, title or f"single-agent survival of guides{bound}")
    return fig


@themed
def swarm_map(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    title: str = "",
    corridors: bool = False,
) -> Figure:
    """Paths of a run's members, with numbered crosses where they were destroyed.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
    guide : Guide, optional
        Drawn dotted.
    title : str
    corridors : bool
        Whether to draw the corridor around the guide.
    """
    ends = trajectory.last_steps()
    paths = [trajectory.positions[: end + 1, member] for member, end in enumerate(ends)]
    fig, axes = _paths_map(scenario, paths, contents=[] if guide is None else [guide.positions])
    if guide is not None:
        if corridors:
            add_corridor(axes, guide.positions, scenario.formation.rho)
        axes.plot(*guide.positions.T, color=INK, lw=scaled(0.9), ls=":", zorder=5, label="guide")
    _mark_losses(axes, trajectory)
    add_legend(fig, axes)
    steps, survivors = counted(len(trajectory.alive) - 1, "step"), int(trajectory.alive[-1].sum())
    add_title(fig, title or scenario.name, f"{survivors} of {len(paths)} alive after {steps}")
    return fig


@themed
def joint_map(
    scenario: Scenario, positions: FloatArray, survival: FloatArray | None = None, title: str = ""
) -> Figure:
    """Paths of a joint plan up to the members' arrivals; the thinner, the less likely to survive.

    Parameters
    ----------
    scenario : Scenario
    positions : (T+1, n, 2)
    survival : (T+1, n), optional
        Survival probability of every member.
    title : str
    """
    paths, labels, alive = [], None, None
    for path in np.moveaxis(positions, 1, 0):
        inside = np.flatnonzero(scenario.target.contains(path[1:]))
        paths.append(path[: inside[0] + 2] if inside.size else path)
    if survival is not None:
        alive = [survival[: len(path), member] for member, path in enumerate(paths)]
        labels = [f"member {k},\nsurvival {each[-1]:.3f}" for k, each in enumerate(alive)]
    fig, axes = _paths_map(scenario, paths, labels, alive, [positions.reshape(-1, 2)])
    add_start(axes, positions[0])
    add_legend(fig, axes)
    add_title(fig, scenario.name, title)
    return fig


def _paths_map(
    scenario: Scenario,
    paths: Sequence[FloatArray],
    labels: Sequence[str] | None = None,
    survival: Sequence[FloatArray] | None = None,
    contents: Sequence[FloatArray] = (),
) -> tuple[Figure, Axes]:
    """Base map with paths (T_k+1, 2), by default of members, as wide as `survival` (T_k+1,).

    Paths often coincide: the first is drawn widest and lowest, so that all stay visible.
    """
    fig, axes = base_map(scenario, [*paths, *contents])
    few = len(paths) <= len(MEMBERS)
    for member, path in enumerate(paths):
        color = MEMBERS[member] if few else BLUE
        widest = 0.3 + 1.5 * (len(paths) - member) if few else 0.6
        alive = np.ones(len(path)) if survival is None else survival[member]
        widths = scaled() * (alive * widest + (1 - alive) * _THINNEST)
        axes.add_collection(
            LineCollection(
                list(np.stack([path[:-1], path[1:]], axis=1)),
                linewidths=widths[1:].tolist(),
                colors=color,
                alpha=1.0 if few else 0.55,
                capstyle="round",
                zorder=4,
            )
        )
        if few:
            size = (widths + scaled()) ** 2
            axes.scatter(path[:, 0], path[:, 1], s=size, color=color, linewidths=0, zorder=4)
            label = labels[member] if labels else f"member {member}"
            axes.plot([], [], color=color, linewidth=scaled(2.5), label=label)
    if not few:
        axes.plot([], [], color=BLUE, label="members")
    return fig, axes


def _mark_losses(axes: Axes, trajectory: RunTrajectory) -> None:
    """Draw crosses where members were destroyed, with their numbers (large swarms: how many)."""
    lost = np.flatnonzero(~trajectory.alive[-1])
    if not lost.size:
        return
    few = trajectory.alive.shape[1] <= len(MEMBERS)
    last = trajectory.positions[trajectory.last_steps()[lost], lost]
    pixel = 1e-6 * float(np.ptp(axes.get_xlim()))
    cells = np.round(last / pixel)
    _, first, groups = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    points = last[first]
    axes.plot(*points.T, zorder=6, label="destroyed", **marker("X", 9 if few else 6))
    reach = _NEAR * float(np.ptp(axes.get_xlim())) if few else 0.0
    unlabelled = list(range(len(points)))
    while unlabelled:
        near = [k for k in unlabelled if np.hypot(*(points[k] - points[unlabelled[0]])) <= reach]
        unlabelled = [k for k in unlabelled if k not in near]
        members = lost[np.isin(groups.reshape(-1), near)]
        number = str(len(members)) if len(members) > 1 else ""
        text = ", ".join(map(str, members)) if few else number
        add_label(axes, text, points[near].mean(axis=0), (6, -9), outlined=True, zorder=7)
