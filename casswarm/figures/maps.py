"""Maps of guides: on hazard rates, or on the cost-to-go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..planning.bounds import CostToGoMap, ValueFunction
from ..planning.guide import Candidate, Guide
from ..planning.kinematics import integrate
from ..scenario import Scenario
from ..typing import FloatArray
from .base_map import add_corridor, add_landmarks, add_start, base_map, extent, set_extent
from .style import (
    BLUE,
    INK,
    VERMILION,
    add_legend,
    add_title,
    scaled,
    single_panel,
    themed,
    wrap,
)


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
    paths = [_path(guide, other) for other in others]
    paths = [path for path in paths if not _same(path, guide.positions)]
    fig, axes = base_map(scenario, [guide.positions, scenario.positions, *paths])
    for number, path in enumerate(paths):
        label = "other candidate paths" if number == 0 else None
        axes.plot(*path.T, color=INK, lw=scaled(0.9), ls=(0, (4, 3)), zorder=3, label=label)
    if scenario.n > 1:
        add_corridor(axes, guide.positions, scenario.formation.rho)
    axes.plot(
        *guide.positions.T,
        color=BLUE,
        marker="o",
        markersize=scaled(3.2),
        linewidth=scaled(1.6),
        zorder=4,
        label=f"guide, {guide.arrival} steps",
    )
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
    image = axes.imshow(
        np.where(costs.survival > 0, costs.survival, np.nan),
        cmap="viridis",
        norm=Normalize(0.0, 1.0),
        extent=(costs.low[0], costs.high[0], costs.low[1], costs.high[1]),
        origin="lower",
        interpolation="bilinear",
    )
    fig.colorbar(image, ax=axes, label=wrap("single-agent survival from here", 0.42))
    moving = np.hypot(*costs.velocities.T) > 0
    starts, arrows = costs.positions[moving], costs.velocities[moving]
    axes.quiver(*starts.T, *arrows.T, color="white", alpha=0.75, zorder=3)
    axes.plot(*guide.positions.T, color=VERMILION, lw=scaled(1.8), zorder=4, label="guide")
    add_landmarks(axes, scenario, radars="white")
    set_extent(axes, low, high)
    add_legend(fig, axes)
    add_title(fig, scenario.name, f"optimal direction at step {costs.step}")
    return fig


def _path(guide: Guide, other: Candidate | FloatArray) -> FloatArray:
    if isinstance(other, Candidate):
        return integrate(guide.positions[0], other.velocities, guide.dt)
    return other


def _same(path: FloatArray, other: FloatArray) -> bool:
    return path.shape == other.shape and bool(np.allclose(path, other, rtol=0, atol=1e-12))
