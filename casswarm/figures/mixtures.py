"""Mixtures of guides, or of joint plans, for a hazard that is not known."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .._util.figure_style import (
    BLUE,
    INK,
    MEMBERS,
    PURPLE,
    SKY,
    AxesLike,
    add_legend,
    add_title,
    heading,
    marker,
    scaled,
    themed,
)
from ..guide.mixture import MixedGuide
from ..joint import MixedPlan
from ..scenario import Scenario
from ..scenario.ambiguity import Mixture
from .maps import add_starts, base_map

_WIDTH = 4.0  # of the path of a mixture of one
_COLORS = BLUE, PURPLE, INK, SKY  # of joint plans


@themed
def mixture_map(
    scenario: Scenario, mixed: Mixture, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Paths of a mixture, as wide as they are likely, on the prior mean of the hazard rates.

    Of joint plans those of all members, in a colour for every plan. Radars that are not in all
    cases have the colour of their case.

    Parameters
    ----------
    scenario : Scenario
        With the cases of the hazard.
    mixed : MixedGuide or MixedPlan
    title, ax
        As in all `casswarm.figures`.
    """
    cases = [case.scenario for case in scenario.cases]
    routes, joint = mixed.routes, isinstance(mixed, MixedPlan)
    visited = [route.reshape(-1, 2) for route in routes]
    fig, axes = base_map(scenario, [scenario.positions, *visited], ax=ax)
    places = [set(map(tuple, case.hazard.radar_positions.tolist())) for case in cases]
    common = set.intersection(*places)
    for number, own in enumerate(places):
        points = np.array(sorted(own - common)).reshape(-1, 2)
        if len(points) and len(cases) < len(MEMBERS):
            shown = marker("^", 8, MEMBERS[1 + number], "white", 0.7)
            axes.plot(*points.T, zorder=5, label=f"radars of case {number}", **shown)
    widest = _WIDTH / 2 if joint else _WIDTH
    for number, (route, weight) in enumerate(zip(routes, mixed.weights, strict=True)):
        label = f"{'plan' if joint else 'path'} with probability {weight:.3f}"
        color = _COLORS[number % len(_COLORS)] if joint else BLUE
        style: dict[str, Any] = {"color": color, "linewidth": scaled(0.5 + widest * float(weight))}
        first, *_ = axes.plot(*np.moveaxis(route, 2, 0), zorder=4, alpha=0.85, **style)
        first.set_label(label)
    add_starts(axes, scenario, "initial positions" if scenario.n > 1 else "start")
    add_legend(axes)
    low, high = mixed.value
    value = f"{low:.3g}" + (f", at most {high:.3g}" if high < 1 else "")
    if isinstance(mixed, MixedGuide) and mixed.objective == "risk":
        value = f"{high:.3g}" + (f", at least {low:.3g}" if low > 0 else "")
    what = "joint plans" if joint else "guides"
    text = f"mixture of {what}, {mixed.measure} {value}"
    add_title(axes, heading(title, scenario.name, text))
    return fig
