"""Mixtures of guides for a hazard that is not known."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from matplotlib.figure import Figure

from .._util.figure_style import (
    MEMBERS,
    AxesLike,
    add_legend,
    add_title,
    heading,
    marker,
    scaled,
    themed,
)
from ..errors import ScenarioError
from ..guide.guide import Guide
from ..scenario import Scenario
from ..typing import FloatArray, Interval
from .maps import add_starts, base_map
from .member_paths import path_style

_WIDTH = 4.0  # of the path of a mixture of one


class Mixture(Protocol):
    """What is drawn of a mixture of guides: `casswarm.MixedGuide` has it."""

    paths: tuple[Guide, ...]
    weights: FloatArray
    prior: FloatArray
    value: Interval


@themed
def mixture_map(
    scenario: Scenario, mixed: Mixture, title: str | None = "", *, ax: AxesLike | None = None
) -> Figure:
    """Paths of a mixture, as wide as they are likely, on the prior mean of the hazard rates.

    Radars that are not in all cases have the colour of their case.

    Parameters
    ----------
    scenario : Scenario
        With the cases of the hazard.
    mixed : MixedGuide
    title, ax
        As in all `casswarm.figures`.
    """
    cases = [case.scenario for case in scenario.cases]
    try:
        shown = scenario.of_mean_rates(mixed.prior)
    except ScenarioError:  # rates of users, which have no mean
        shown = cases[0]
    paths = [path.positions for path in mixed.paths]
    fig, axes = base_map(shown, [scenario.positions, *paths], ax=ax)
    places = [set(map(tuple, case.hazard.radar_positions.tolist())) for case in cases]
    common = set.intersection(*places)
    for number, own in enumerate(places):
        points = np.array(sorted(own - common)).reshape(-1, 2)
        if len(points) and len(cases) <= len(MEMBERS):
            style = marker("^", 8, MEMBERS[number], "white", 0.7)
            axes.plot(*points.T, zorder=5, label=f"radars of case {number}", **style)
    for number, (path, weight) in enumerate(zip(paths, mixed.weights, strict=True)):
        style = path_style(number if len(paths) <= len(MEMBERS) else -1)
        style |= {"linewidth": scaled(0.5 + _WIDTH * float(weight)), "alpha": 0.85}
        axes.plot(*path.T, zorder=4, label=f"path with probability {weight:.3f}", **style)
    add_starts(axes, scenario, "initial positions" if scenario.n > 1 else "start")
    add_legend(axes)
    low, high = mixed.value
    bound = f", at most {high:.3g}" if high < 1 else ""
    add_title(axes, heading(title, scenario.name, f"mixture of guides, survival {low:.3g}{bound}"))
    return fig
