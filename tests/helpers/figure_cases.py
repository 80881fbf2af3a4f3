"""Small data for figures, without solving or sampling."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from small_scenarios import DT, three_members

from casswarm import Guide, OutcomeDistribution, Residuals, Solution, Status
from casswarm.chain import RunTrajectory
from casswarm.figures import THEMES

SCENARIO = three_members()

PATH = np.array([[0.0, 0.0], [0.6, -0.3], [1.2, -0.5], [2.0, -0.3], [2.8, 0.0]])
GUIDE = Guide(
    positions=PATH,
    velocities=np.diff(PATH, axis=0) / DT,
    rates=SCENARIO.hazard.single_agent_rates(PATH[1:]),
    dt=DT,
    center=np.array([3.0, 0.0]),
    arrives=True,
    solution=Solution(
        np.empty(0), 0.0, Status.SOLVED, "by hand", "none", Residuals(0.0, 0.0, 0.0), 0, 0, 0.0, 0.0
    ),
    risk_bound=0.1,
)


def trajectory(steps: int = 3) -> RunTrajectory:
    """Three members approach the guide; the second is destroyed at step 2."""
    offsets = np.array([[0.0, 0.0], [0.3, 0.2], [-0.2, 0.3]])
    positions = np.stack([PATH[t] + offsets / (1 + t) ** 2 for t in range(steps + 1)])
    positions[3:, 1] = positions[2, 1]
    alive = np.ones((steps + 1, 3), bool)
    alive[2:, 1] = False
    return RunTrajectory(positions, alive, np.array([1, 1, 0])[:steps])


RUN = trajectory()


def table(**columns: object) -> pd.DataFrame:
    """Table with these columns."""
    return pd.DataFrame(columns)


SUMMARY = table(
    policy=["naive", "leader"],
    runs=[10, 10],
    success=[0.3, 0.7],
    success_low=[0.2, 0.6],
    success_high=[0.4, 0.8],
)
PAIRED = table(
    first=["naive"],
    second=["leader"],
    difference=[-0.4],
    difference_low=[-0.5],
    difference_high=[-0.2],
)


def distribution(policy: str, arrival: tuple[float, float]) -> OutcomeDistribution:
    """Distribution over three steps: arrivals at steps 2 and 3, some residual mass."""
    alive = np.array([1.0, 0.9, 0.8, 0.7])
    unknown = np.array([0.0, 0.0, 0.01, 0.02])
    population = np.zeros((4, 4))
    population[:, 3] = alive - unknown
    population[:, 0] = 1 - alive
    return OutcomeDistribution(
        policy=policy,
        arrival=np.array([0.0, 0.0, *arrival]),
        survivors=population[-1],
        members=np.full(3, 0.68),
        population=population,
        residual_mass_before=unknown,
        residual_mass=0.02,
        states=7,
        infeasible=0.5,
        failures=0.0,
        tolerance=0.05,
        aggregation_tol=0.0,
    )


DISTRIBUTIONS = [distribution("naive", (0.1, 0.2)), distribution("leader", (0.3, 0.4))]


def sweep_table() -> pd.DataFrame:
    """Two policies at four sweep points each, one of which failed."""
    points = [(1, 0.1), (1, 0.2), (3, 0.1), (3, 0.2)]
    found = pd.DataFrame(points * 2, columns=["n", "rho"])
    success = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, np.nan])
    return found.assign(
        policy=["naive"] * 4 + ["leader"] * 4,
        success=success,
        success_low=success - 0.05,
        success_high=success + 0.05,
        status=["ok"] * 7 + ["failed"],
    )


def assert_fits(fig: Figure, name: str) -> None:
    """Assert that a figure has the width of a theme, and that its contents are within it."""
    fig.draw_without_rendering()
    width, height = fig.get_size_inches()
    assert width == THEMES[name].width
    assert 0.25 * width < height < 3 * width
    box = fig.get_tightbbox()
    assert box.x0 > -0.02
    assert box.x1 < width + 0.02
    assert box.y0 > -0.02
    assert box.y1 < height + 0.02


def legend_of(fig: Figure) -> list[str]:
    """Entries of the legends of a figure and of its panels."""
    legends = [*fig.legends, *(a.get_legend() for a in fig.axes if a.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def markers(axes: Axes, marker: str) -> list[Line2D]:
    """Lines of a panel that are drawn with a marker."""
    return [line for line in axes.get_lines() if line.get_marker() == marker]
