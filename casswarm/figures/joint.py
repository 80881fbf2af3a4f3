"""The joint plan: the ways of all members over the map of rates."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ..scenario import Scenario
from ..typing import FloatArray
from .base_map import single_agent_map
from .style import BLUE, INK, MEMBERS, add_legend, add_title, scaled, themed

_WIDEST, _THINNEST = 2.0, 0.3  # of the uppermost member's line, alive and dead
_STEP = 1.6  # by which each member below is wider: members often share a way
_MANY = 0.8  # width of all lines in a large swarm


@themed
def joint_map(
    scenario: Scenario, positions: FloatArray, survival: FloatArray | None = None, title: str = ""
) -> Figure:
    """Members' ways; lines get thinner as survival gets less likely, a dot a step.

    Members often share a way: the first is drawn widest and lowest, so that all stay visible.

    Parameters
    ----------
    scenario : Scenario
    positions : (T+1, n, 2)
        Drawn up to a member's arrival.
    survival : (T+1, n), optional
        Of every member.
    title : str
    """
    fig, axes, _ = single_agent_map(scenario, [positions.reshape(-1, 2)])
    members = positions.shape[1]
    few = members <= len(MEMBERS)
    for member in range(members):
        way = _until_arrival(scenario, positions[:, member])
        color = MEMBERS[member] if few else BLUE
        alive = np.ones(len(way)) if survival is None else survival[: len(way), member]
        widest = _WIDEST + _STEP * (members - 1 - member) if few else _MANY
        widths = scaled() * (alive * widest + (1 - alive) * _THINNEST)
        axes.add_collection(
            LineCollection(
                list(np.stack([way[:-1], way[1:]], axis=1)),
                linewidths=widths[1:].tolist(),
                colors=color,
                capstyle="round",
                zorder=4,
            )
        )
        size = (widths + scaled(0.8)) ** 2
        axes.scatter(way[:, 0], way[:, 1], s=size, color=color, linewidths=0, zorder=4)
        told = f"member {member + 1}"
        if survival is not None:
            told += f",\nsurvives with {alive[-1]:.3f}"
        if few:
            axes.plot([], [], color=color, linewidth=scaled(2.5), label=told)
    axes.plot(
        *positions[0].T,
        linestyle="",
        marker="o",
        markersize=scaled(4.5),
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=5,
        label="start",
    )
    add_legend(fig, axes)
    add_title(fig, scenario.name, title)
    return fig


def _until_arrival(scenario: Scenario, way: FloatArray) -> FloatArray:
    """A member's way up to its arrival."""
    inside = np.flatnonzero(scenario.target.contains(way[1:]))
    return way[: inside[0] + 2] if inside.size else way
