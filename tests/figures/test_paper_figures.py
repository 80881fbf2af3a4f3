"""Figures of the paper reproduced and of look-ahead: what is in them, and that it fits."""

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
    beyond_chart,
    convergence_chart,
    infeasible_chart,
    joint_map,
    member_guides_map,
    mpc_chart,
    sensitivity_chart,
    table_2_chart,
    theme,
)
from casswarm.figures.style import POLICIES

TABLE_2 = pd.DataFrame(
    {
        "policy": ["naive", "leader"],
        **{
            f"{kind}{end}": [low + shift, high + shift]
            for kind, low, high in (("paper", 0.3, 0.6), ("runs_50", 0.28, 0.62))
            for end, shift in (("", 0.0), ("_low", -0.1), ("_high", 0.1))
        },
        **{f"runs_100{end}": [0.31, 0.64] for end in ("", "_low", "_high")},
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
    {"change": ["none", "a = 0.05"], "naive": [0.3, 0.4], "leader": [0.6, 0.7]}
)
PATH = pd.DataFrame(
    {"iteration": [0, 10, 1000], "survival": [1e-4, 2e-4, 1e-3], "residual": [1e-4, 1e-4, 1e-3]}
)
FORMATIONS = pd.DataFrame(
    {
        "problems": ["leader, I"] * 2 + ["constrained, I"] * 2 + ["leader, II"] * 2,
        "iteration": [0, 100] * 3,
        "gap_median": [1.0, 0.1, 0.5, 0.0, 2.0, 0.4],
        "residual_median": [1e-2, 1e-4] * 3,
    }
)
SHORTFALLS = pd.DataFrame(
    {
        "policy": ["constrained"] * 3 + ["leader"] * 3,
        "step": [0, 1, 2] * 2,
        "alive": [3.0, 2.5, 2.0, 3.0, 2.8, 2.1],
        "short": [2.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    }
)
AHEAD = pd.DataFrame(
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
DRAWN: dict[str, Callable[[], Figure]] = {
    "guides": lambda: member_guides_map(SCENARIO, [GUIDE, GUIDE], "mine"),
    "joint": lambda: joint_map(SCENARIO, np.repeat(GUIDE.positions[:, None], 3, axis=1)),
    "table 2": lambda: table_2_chart(TABLE_2, 100),
    "beyond": lambda: beyond_chart(BEYOND),
    "sensitivity": lambda: sensitivity_chart(
        SENSITIVITY, {"naive": (0.2, 0.5), "leader": (0.5, 0.8)}
    ),
    "convergence": lambda: convergence_chart(PATH, FORMATIONS, {"Ipopt": 0.03, "global": 0.7}),
    "infeasible": lambda: infeasible_chart(SHORTFALLS),
    "ahead": lambda: mpc_chart(AHEAD, "looking ahead"),
}


@pytest.mark.parametrize("name", ["column", "slide"])
@pytest.mark.parametrize("what", DRAWN)
def test_figure_has_the_width_of_its_look_and_keeps_all_within_it(what: str, name: str) -> None:
    with theme(name):
        fig = DRAWN[what]()
    assert_fits(fig, name)


def points(axes: Axes, marker: str) -> list[tuple[float, str]]:
    """Places along x, and colours, of what is drawn with a marker."""
    lines = [line for line in axes.get_lines() if line.get_marker() == marker]
    return [(float(line.get_xdata()[0]), to_hex(line.get_color())) for line in lines]


def colors(*policies: str) -> list[str]:
    return [POLICIES[policy].color.lower() for policy in policies]


def test_table_2_has_a_sign_a_kind_and_a_colour_a_policy() -> None:
    axes = DRAWN["table 2"]().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["naive", "leader"]
    for marker, values in (("s", (0.3, 0.6)), ("D", (0.31, 0.64)), ("|", (0.3102, 0.6402))):
        found = points(axes, marker)
        assert [x for x, _ in found] == pytest.approx(values)
        assert [color for _, color in found] == colors("naive", "leader")


def test_beyond_has_the_middle_of_every_bracket() -> None:
    fig = DRAWN["beyond"]()
    assert [x for x, _ in points(fig.axes[0], "o")] == pytest.approx([0.1, 0.3])
    ahead = points(fig.axes[0], POLICIES["leader-mpc"].marker)
    assert [x for x, _ in ahead] == pytest.approx([0.25, 0.45])
    assert {color for _, color in ahead} == set(colors("leader-mpc"))
    assert [t.get_text() for t in fig.legends[0].get_texts()] == ["naive", "leader-mpc-3"]


def test_sensitivity_has_a_panel_a_policy_with_its_interval() -> None:
    fig = DRAWN["sensitivity"]()
    assert [axes.get_title() for axes in fig.axes] == ["naive", "leader"]
    band = fig.axes[1].patches[0]
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((0.5, 0.8))
    dots = next(line for line in fig.axes[1].get_lines() if line.get_marker() == "D")
    np.testing.assert_array_equal(dots.get_xdata(), SENSITIVITY["leader"])


def test_convergence_has_policies_by_colour_and_scenarios_by_dashes() -> None:
    gap = DRAWN["convergence"]().axes[2]
    lines = {line.get_label(): line for line in gap.get_lines()}
    assert list(lines) == ["leader, I", "constrained, I", "leader, II"]
    assert [to_hex(line.get_color()) for line in lines.values()] == colors(
        "leader", "constrained", "leader"
    )
    assert lines["leader, I"].get_linestyle() != lines["leader, II"].get_linestyle()
    np.testing.assert_array_equal(lines["constrained, I"].get_ydata(), [0.5, 1e-9])


def test_shortfalls_are_bars_below_the_living() -> None:
    fig = DRAWN["infeasible"]()
    assert [bar.get_height() for bar in fig.axes[0].patches] == [2.0, 0.0, 1.0]
    np.testing.assert_array_equal(fig.axes[1].get_lines()[0].get_ydata(), [3.0, 2.8, 2.1])


def test_look_ahead_has_a_pair_of_panels_a_scenario_and_none_to_spare() -> None:
    with theme("page"):
        shown = [axes for axes in DRAWN["ahead"]().axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown if axes.get_title()] == [
        *("one", "two", "three", "four")
    ]
    assert len(shown) == 8
    line = shown[3].get_lines()[0]  # below the first three
    np.testing.assert_allclose(line.get_xydata(), [[1, 10], [3, 10 / 3], [8, 1.25]])
    assert to_hex(line.get_color()) == colors("leader-mpc")[0]
