"""Figures of the paper's reproduction and of MPC policies: contents and sizes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from figure_cases import GUIDE, SCENARIO, assert_fits
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from casswarm.figures import (
    convergence_chart,
    infeasible_chart,
    joint_map,
    mpc_chart,
    sensitivity_chart,
    success_chart,
    table_2_chart,
    theme,
)
from casswarm.figures.success import POLICIES

TABLE_2 = pd.DataFrame(
    {
        "policy": ["naive", "leader"],
        **{
            f"{kind}{end}": [low + shift, high + shift]
            for kind, low, high in (("paper", 0.3, 0.6), ("runs_50", 0.28, 0.62))
            for end, shift in (("", 0.0), ("_low", -0.1), ("_high", 0.1))
        },
        **{f"method{end}": [0.31, 0.64] for end in ("_low", "_high")},
        "exact_low": [0.3101, 0.6401],
        "exact_high": [0.3103, 0.6403],
    }
)
BEYOND = pd.DataFrame(
    {
        "scenario": ["one", "one", "another, t_f = 4", "another, t_f = 4"],
        "policy": ["naive", "leader-mpc-3"] * 2,
        "success_low": [0.1, 0.2, 0.3, 0.4],
        "success_high": [0.1, 0.3, 0.3, 0.5],
    }
)
SENSITIVITY = pd.DataFrame(
    {
        "solver": ["gradient", "gradient", "ipopt"],
        "change": ["none", "a = 0.05", "none"],
        **{
            f"{policy}{end}": [value + shift for value in values]
            for policy, values in (("naive", (0.3, 0.4, 0.35)), ("leader", (0.6, 0.7, 0.65)))
            for end, shift in (("", 0.0), ("_low", -0.05), ("_high", 0.05))
        },
    }
)
PATH = pd.DataFrame(
    {
        "steps": ["displacement"] * 3 + ["velocity"] * 2,
        "iteration": [0, 10, 1000, 0, 10],
        "survival": [1e-4, 2e-4, 1e-3, 1e-4, 1e-4],
        "residual": [1e-4, 1e-4, 1e-3, 1e-4, 1e-4],
    }
)
FORMATIONS = pd.DataFrame(
    {
        "problems": ["leader, I"] * 2 + ["constrained, I"] * 2 + ["leader, II"] * 2,
        "steps": ["displacement"] * 6,
        "iteration": [0, 100] * 3,
        "gap_median": [1.0, 0.1, 0.5, 0.0, 2.0, 0.4],
        "residual_median": [1e-2, 1e-4] * 3,
    }
)
INFEASIBLE = pd.DataFrame(
    {
        "policy": ["constrained"] * 3 + ["leader"] * 3,
        "step": [0, 1, 2] * 2,
        "alive": [3.0, 2.5, 2.0, 3.0, 2.8, 2.1],
        "infeasible": [2.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    }
)
HORIZONS = pd.DataFrame(
    [
        {
            "scenario": scenario,
            "policy": policy,
            "horizon": steps,
            "success": 0.5 + 0.01 * steps,
            "success_low": 0.45,
            "success_high": 0.6,
            "infeasible": 10.0 / steps,
        }
        for scenario in ("one", "two", "three", "four")
        for policy in ("leader-mpc-3", "mine")
        for steps in (8, 1, 3)
    ]
)
FIGURES: dict[str, Callable[[], Figure]] = {
    "joint": lambda: joint_map(SCENARIO, np.repeat(GUIDE.positions[:, None], 3, axis=1)),
    "table 2": lambda: table_2_chart(TABLE_2),
    "scenarios": lambda: success_chart(BEYOND),
    "sensitivity": lambda: sensitivity_chart(
        SENSITIVITY, {"naive": (0.2, 0.5), "leader": (0.5, 0.8)}
    ),
    "convergence": lambda: convergence_chart(PATH, FORMATIONS, {"Ipopt": 0.03, "global": 0.7}),
    "infeasible": lambda: infeasible_chart(INFEASIBLE),
    "mpc": lambda: mpc_chart(HORIZONS, "MPC"),
}


@pytest.mark.parametrize("name", ["column", "slide"])
@pytest.mark.parametrize("what", FIGURES)
def test_figure_in_theme_has_its_width_and_fits(what: str, name: str) -> None:
    with theme(name):
        fig = FIGURES[what]()
    assert_fits(fig, name)


def points(axes: Axes, marker: str) -> list[tuple[float, str]]:
    """Abscissas and colours of lines with a marker."""
    lines = [line for line in axes.get_lines() if line.get_marker() == marker]
    return [(float(line.get_xdata()[0]), to_hex(line.get_color())) for line in lines]


def colors(*policies: str) -> list[str]:
    return [POLICIES[policy].color.lower() for policy in policies]


def test_table_2_chart_has_marker_per_kind_and_colour_per_policy() -> None:
    axes = FIGURES["table 2"]().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["naive", "leader"]
    for marker, values in (("s", (0.3, 0.6)), ("D", (0.31, 0.64)), ("|", (0.3102, 0.6402))):
        drawn = points(axes, marker)
        assert [x for x, _ in drawn] == pytest.approx(values)
        assert [color for _, color in drawn] == colors("naive", "leader")


def test_success_chart_of_scenarios_has_panel_for_each() -> None:
    panels = FIGURES["scenarios"]().axes
    assert panels[0].get_title() == "one"
    for panel, low, high in (
        (panels[0], [0.1, 0.2], [0.1, 0.3]),
        (panels[1], [0.3, 0.4], [0.3, 0.5]),
    ):
        assert [bar.get_width() for bar in panel.patches] == low
        assert [to_hex(bar.get_facecolor()) for bar in panel.patches] == colors(
            "naive", "leader-mpc"
        )
        ends = [segment[1, 0] for lines in panel.collections for segment in lines.get_segments()]
        assert ends == pytest.approx(high)
    assert [label.get_text() for label in panels[0].get_yticklabels()] == ["naive", "leader-mpc-3"]


def test_success_chart_with_bound_draws_it() -> None:
    panels = success_chart(BEYOND.assign(bound=[0.5, 0.5, 0.9, 0.9])).axes
    lines = [
        next(line for line in panel.get_lines() if line.get_linestyle() == "--") for panel in panels
    ]
    assert [line.get_xdata()[0] for line in lines] == [0.5, 0.9]
    assert panels[1].get_title().endswith("no policy exceeds 0.900")


def test_sensitivity_chart_has_panel_per_policy_with_interval() -> None:
    fig = FIGURES["sensitivity"]()
    assert [axes.get_title() for axes in fig.axes] == ["naive", "leader"]
    band = fig.axes[1].patches[0]
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((0.5, 0.8))
    filled, hollow = (line for line in fig.axes[1].get_lines() if line.get_marker() == "D")
    np.testing.assert_array_equal(filled.get_xdata(), [0.6, 0.7])
    np.testing.assert_array_equal(hollow.get_xdata(), [0.65])
    assert hollow.get_markerfacecolor() == "white"


def test_convergence_chart_has_colours_of_policies() -> None:
    gap = FIGURES["convergence"]().axes[2]
    lines = {line.get_label(): line for line in gap.get_lines()}
    assert list(lines) == ["leader, I", "constrained, I", "leader, II"]
    assert [to_hex(line.get_color()) for line in lines.values()] == colors(
        "leader", "constrained", "leader"
    )
    assert lines["leader, I"].get_linestyle() != lines["leader, II"].get_linestyle()
    np.testing.assert_array_equal(lines["constrained, I"].get_ydata(), [0.5, 1e-9])


def test_infeasible_chart_has_bars_and_members_alive() -> None:
    fig = FIGURES["infeasible"]()
    assert [bar.get_height() for bar in fig.axes[0].patches] == [2.0, 0.0, 1.0]
    np.testing.assert_array_equal(fig.axes[1].get_lines()[0].get_ydata(), [3.0, 2.8, 2.1])


def test_mpc_chart_has_two_panels_per_scenario() -> None:
    with theme("page"):
        shown = [axes for axes in FIGURES["mpc"]().axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown if axes.get_title()] == [
        *("one", "two", "three", "four")
    ]
    assert len(shown) == 8
    line = shown[3].get_lines()[0]  # below the first three
    np.testing.assert_allclose(line.get_xydata(), [[1, 10], [3, 10 / 3], [8, 1.25]])
    assert to_hex(line.get_color()) == colors("leader-mpc")[0]
