"""The joint plan: the ways of all members over the map of rates."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..scenario import Scenario
from ..swarm import SwarmPlan
from .maps import _finish, _map
from .style import INK, MEMBERS

_WIDEST, _THINNEST = 2.0, 0.3  # points, of the uppermost member's line, alive and dead
_STEP = 1.6  # by which each member below is wider: members often share a way
_MANY = 0.8  # width of all lines in a large swarm


def joint_map(scenario: Scenario, plan: SwarmPlan) -> Figure:
    """Members' ways; lines get thinner as survival gets less likely, a dot a step.

    Members often share a way: the first is drawn widest and lowest, so that all stay visible.
    """
    fig, axes = _map(scenario, [plan.positions.reshape(-1, 2)])
    few = plan.n <= len(MEMBERS)
    handles = []
    for member in range(plan.n):
        way = plan.positions[: _last(plan, member) + 1, member]
        color = MEMBERS[member % len(MEMBERS)]
        alive = np.ones(len(way)) if plan.law is None else plan.law.survival[: len(way), member]
        above = _STEP * (plan.n - 1 - member) if few else 0.0
        widest = _WIDEST if few else _MANY
        widths = alive * (widest + above) + (1 - alive) * _THINNEST
        axes.add_collection(
            LineCollection(
                list(np.stack([way[:-1], way[1:]], axis=1)),
                linewidths=widths[1:].tolist(),
                colors=color,
                capstyle="round",
                zorder=4,
            )
        )
        axes.scatter(*way.T, s=(widths + 1.0) ** 2, color=color, linewidths=0, zorder=4)
        if few:
            told = f"member {member + 1}"
            told += "" if plan.law is None else f", alive at the end {alive[-1]:.3f}"
            handles.append(Line2D([], [], color=color, linewidth=2.5, label=told))
    starts = plan.positions[0]
    axes.plot(
        *starts.T,
        linestyle="",
        marker="o",
        markersize=4.5,
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=5,
    )
    for handle in handles:
        axes.add_artist(handle)
    success = f"success {plan.value:.4f} by the mean field"
    if plan.law is not None:
        success = f"success {1 - plan.law.failure:.6g}"
    bound = "" if plan.bound is None or not plan.bound.certified else f"\n{plan.bound}"
    _finish(fig, axes, f"{plan.scenario}: joint plan, {success}{bound}")
    return fig


def _last(plan: SwarmPlan, member: int) -> int:
    """The step at which a member's way ends: on arrival."""
    return int(plan.arrivals[member]) or plan.steps
