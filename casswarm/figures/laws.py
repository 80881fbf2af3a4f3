"""Exact laws: when the swarm has arrived, and with how many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..chain.law import Law
from .style import MEMBERS, POLICIES, figure, tidy


def arrival_chart(laws: Sequence[Law], title: str = "") -> Figure:
    """Probability of having arrived by every step, a band a policy as wide as its bracket."""
    fig, axes = figure(6.4, 4.2)
    for place, law in enumerate(laws):
        color = POLICIES.get(law.policy, MEMBERS[place % len(MEMBERS)])
        low = np.cumsum(law.arrival)
        steps = np.arange(len(low))
        axes.fill_between(
            steps, low, np.minimum(1.0, low + law.unknown), step="post", color=color, alpha=0.3
        )
        first, last = law.success
        axes.step(
            steps,
            low,
            where="post",
            color=color,
            linewidth=2,
            linestyle=("-", "--", "-.", ":")[place % 4],
            label=f"{law.policy}: {first:.4f} to {last:.4f}",
        )
    axes.set(xlabel="step", ylabel="probability of arrival so far", ylim=(0, 1))
    axes.set_xlim(0, len(laws[0].arrival) - 1)
    axes.set_title(f"{title}: exact law".removeprefix(": "), fontsize=11)
    axes.legend(loc="upper left", frameon=False)
    tidy(axes)
    return fig


def population_chart(laws: Sequence[Law], members: int, title: str = "") -> Figure:
    """Mean number of members alive at every step, a band a policy as wide as its bracket."""
    fig, axes = figure(6.4, 4.2)
    for place, law in enumerate(laws):
        color = POLICIES.get(law.policy, MEMBERS[place % len(MEMBERS)])
        low, high = law.population_mean
        steps = np.arange(len(low))
        axes.fill_between(
            steps, low, np.minimum(members, high), step="post", color=color, alpha=0.3
        )
        style = ("-", "--", "-.", ":")[place % 4]
        axes.step(
            steps, low, where="post", color=color, linewidth=2, linestyle=style, label=law.policy
        )
    axes.set(xlabel="step", ylabel="members alive, mean", ylim=(0, 1.02 * members))
    axes.set_xlim(0, len(laws[0].arrival) - 1)
    axes.set_title(f"{title}: exact law".removeprefix(": "), fontsize=11)
    axes.legend(loc="lower left", frameon=False)
    tidy(axes)
    return fig
