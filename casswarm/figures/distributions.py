"""Exact distributions over time: arrivals, members alive, and survival of the swarm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..chain.distribution import OutcomeDistribution
from ..typing import FloatArray
from .policy_styles import policy_styles
from .style import add_title, despine, scaled, single_panel, themed


@themed
def arrival_chart(distributions: Sequence[OutcomeDistribution], title: str = "") -> Figure:
    """Probability of arrival up to every step, a band per policy from lower to upper bound."""
    low = [np.cumsum(each.arrival) for each in distributions]
    high = [
        np.minimum(1.0, bound + each.residual_mass_before)
        for bound, each in zip(low, distributions, strict=True)
    ]
    bounds = list(zip(low, high, strict=True))
    fig, axes = _bands(distributions, bounds, title, "probability of arrival")
    labels = [f"{d.policy}: {d.success[0]:.4f} to {d.success[1]:.4f}" for d in distributions]
    axes.legend(axes.get_lines(), labels, loc="upper left")
    return fig


@themed
def population_chart(
    distributions: Sequence[OutcomeDistribution], members: int, title: str = ""
) -> Figure:
    """Mean number of members alive at every step, a band per policy from lower to upper bound."""
    means = [each.population_mean for each in distributions]
    bounds = [(mean.low, np.minimum(float(members), mean.high)) for mean in means]
    fig, axes = _bands(distributions, bounds, title, "mean number of members alive", members)
    axes.legend(loc="lower left")
    return fig


@themed
def survival_chart(distributions: Sequence[OutcomeDistribution], title: str = "") -> Figure:
    """Probability that any member is alive at every step, from lower to upper bound.

    After arrival a run keeps the number of members that arrived.
    """
    bounds = [each.any_alive for each in distributions]
    fig, axes = _bands(distributions, bounds, title, "probability that any member is alive")
    axes.legend(loc="lower left")
    return fig


def _bands(
    distributions: Sequence[OutcomeDistribution],
    bounds: Sequence[tuple[FloatArray, FloatArray]],
    title: str,
    ylabel: str,
    top: float = 1.0,
) -> tuple[Figure, Axes]:
    """Step curves of the lower bounds (N+1,), with bands up to the upper bounds, up to `top`."""
    fig, axes = single_panel()
    styles = policy_styles(each.policy for each in distributions)
    for (low, high), (policy, style) in zip(bounds, styles.items(), strict=True):
        steps = np.arange(len(low))
        axes.fill_between(steps, low, high, step="post", color=style.color, alpha=0.3, linewidth=0)
        (line,) = axes.step(steps, low, where="post", color=style.color, linestyle=style.dashes)
        line.set(linewidth=scaled(1.8), label=policy)
    axes.set(xlabel="step", xlim=(0, 1.01 * (max(len(low) for low, _ in bounds) - 1)))
    axes.set(ylabel=ylabel, ylim=(0, 1.02 * top))
    add_title(fig, title, "exact distribution")
    despine(axes)
    return fig, axes
