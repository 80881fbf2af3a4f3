"""Exact laws: when the swarm has arrived, how many are alive, and whether anybody is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..chain.distribution import OutcomeDistribution
from ..typing import FloatArray
from .style import add_title, despine, figure, policy_styles, scaled, themed


@themed
def arrival_chart(laws: Sequence[OutcomeDistribution], title: str = "") -> Figure:
    """Probability of having arrived by every step, a band a policy as wide as its bracket."""
    curves = {}
    for law in laws:
        low, (first, last) = np.cumsum(law.arrival), law.success
        label = f"{law.policy}: {first:.4f} to {last:.4f}"
        curves[label] = (law.policy, low, np.minimum(1.0, low + law.residual_mass_before))
    fig, axes = _chart(curves, title)
    axes.set(ylabel="probability of arrival so far", ylim=(0, 1.02))
    axes.legend(loc="upper left")
    return fig


@themed
def population_chart(laws: Sequence[OutcomeDistribution], members: int, title: str = "") -> Figure:
    """Mean number of members alive at every step, a band a policy as wide as its bracket."""
    curves = {}
    for law in laws:
        low, high = law.population_mean
        curves[law.policy] = (law.policy, low, np.minimum(members, high))
    fig, axes = _chart(curves, title)
    axes.set(ylabel="members alive, mean", ylim=(0, 1.02 * members))
    axes.legend(loc="lower left")
    return fig


@themed
def survival_chart(laws: Sequence[OutcomeDistribution], title: str = "") -> Figure:
    """Probability that somebody is alive at every step, a band a policy as wide as its bracket.

    A run that has arrived keeps the number of members that arrived.
    """
    curves = {}
    for law in laws:
        low, high = law.any_alive
        curves[law.policy] = (law.policy, low, high)
    fig, axes = _chart(curves, title)
    axes.set(ylabel="probability that somebody is alive", ylim=(0, 1.02))
    axes.legend(loc="lower left")
    return fig


def _chart(
    curves: dict[str, tuple[str, FloatArray, FloatArray]], title: str
) -> tuple[Figure, Axes]:
    """Step curves over time: label to policy, low end and high end, (N+1,) each."""
    fig, axes = figure()
    looks = policy_styles(policy for policy, *_ in curves.values())
    for label, (policy, low, high) in curves.items():
        mark, steps = looks[policy], np.arange(len(low))
        axes.fill_between(steps, low, high, step="post", color=mark.color, alpha=0.3, linewidth=0)
        axes.step(
            steps,
            low,
            where="post",
            color=mark.color,
            linewidth=scaled(1.8),
            linestyle=mark.dashes,
            label=label,
        )
    axes.set(xlabel="step", xlim=(0, max(len(low) for _, low, _ in curves.values()) - 1))
    add_title(fig, title, "exact law")
    despine(axes)
    return fig, axes
