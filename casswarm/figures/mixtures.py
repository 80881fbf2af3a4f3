"""Mixtures of guides for a hazard that is not known."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from .._util.figure_style import (
    BLUE,
    MEMBERS,
    AxesLike,
    add_legend,
    add_title,
    heading,
    marker,
    scaled,
    themed,
)
from ..guide.mixture import MixedGuide
from ..scenario import Scenario
from .maps import add_starts, base_map

_WIDTH = 4.0  # of the path of a mixture of one


@themed
def mixture_map(
    scenario: Scenario, mixed: MixedGuide, title: str | None = "", *, ax: AxesLike | None = None
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
    paths = [path.positions for path in mixed.paths]
    fig, axes = base_map(scenario, [scenario.positions, *paths], ax=ax)
    places = [set(map(tuple, case.hazard.radar_positions.tolist())) for case in cases]
    common = set.intersection(*places)
    for number, own in enumerate(places):
        points = np.array(sorted(own - common)).reshape(-1, 2)
        if len(points) and len(cases) < len(MEMBERS):
            style = marker("^", 8, MEMBERS[1 + number], "white", 0.7)
            axes.plot(*points.T, zorder=5, label=f"radars of case {number}", **style)
    for path, weight in zip(paths, mixed.weights, strict=True):
        width, label = scaled(0.5 + _WIDTH * float(weight)), f"path with probability {weight:.3f}"
        axes.plot(*path.T, zorder=4, label=label, color=BLUE, linewidth=width, alpha=0.85)
    add_starts(axes, scenario, "initial positions" if scenario.n > 1 else "start")
    add_legend(axes)
    low, high = mixed.value
    bound = f", at most {high:.3g}" if high < 1 else ""
    add_title(axes, heading(title, scenario.name, f"mixture of guides, survival {low:.3g}{bound}"))
    return fig
