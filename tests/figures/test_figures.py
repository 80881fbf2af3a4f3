"""Figures of small data: contents, sizes, and reproducible files."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from figure_cases import (
    DISTRIBUTIONS,
    GUIDE,
    PAIRED,
    RUN,
    SCENARIO,
    SUMMARY,
    assert_fits,
    legend_of,
    markers,
    sweep_table,
    table,
)
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.text import Text
from PIL import Image

from casswarm.chain import RunTrajectory
from casswarm.figures import (
    THEMES,
    animate,
    arrival_chart,
    band_chart,
    comparison_map,
    convergence_chart,
    cost_to_go_map,
    difference_chart,
    formation_chart,
    gap_chart,
    guide_map,
    infeasible_chart,
    joint_map,
    mpc_chart,
    population_chart,
    profile_chart,
    ranking_chart,
    save,
    sensitivity_chart,
    success_chart,
    survival_chart,
    swarm_map,
    sweep_heat_map,
    sweep_lines,
    table_2_chart,
    theme,
)
from casswarm.figures.success import POLICIES, policy_styles
from casswarm.grid import CostToGoMap

PROFILE = pd.DataFrame({"fast": [0.5, 1.0], "slow": [0.0, 0.5]}, index=[1.0, 4.0])
RANKING = table(
    solver=["fast", "projected-gradient"],
    mean_ms=[1.5, 400.0],
    mean_ms_low=[1.0, np.nan],
    mean_ms_high=[2.0, np.nan],
    rank=[1.0, 2.0],
    probability=[0.93, np.nan],
)
COSTS = CostToGoMap(
    0,
    np.array([-2.0, -2.0]),
    np.array([5.0, 4.0]),
    np.linspace(0, 1, 9).reshape(3, 3),
    np.array([[0.0, 0.0], [1.0, 1.0]]),
    np.array([[1.0, 0.0], [0.0, 0.0]]),
)
TABLE_2 = table(
    policy=["naive", "leader"],
    **{
        f"{kind}{end}": [low + shift, high + shift]
        for kind, low, high in (("paper", 0.3, 0.6), ("runs_50", 0.28, 0.62))
        for end, shift in (("", 0.0), ("_low", -0.1), ("_high", 0.1))
    },
    **{f"method{end}": [0.31, 0.64] for end in ("_low", "_high")},
    exact_low=[0.3101, 0.6401],
    exact_high=[0.3103, 0.6403],
)
BEYOND = table(
    scenario=["one", "one", "another, t_f = 4", "another, t_f = 4"],
    policy=["naive", "leader-mpc-3"] * 2,
    success_low=[0.1, 0.2, 0.3, 0.4],
    success_high=[0.1, 0.3, 0.3, 0.5],
)
SENSITIVITY = table(
    solver=["gradient", "gradient", "ipopt"],
    change=["none", "a = 0.05", "none"],
    **{
        f"{policy}{end}": [value + shift for value in values]
        for policy, values in (("naive", (0.3, 0.4, 0.35)), ("leader", (0.6, 0.7, 0.65)))
        for end, shift in (("", 0.0), ("_low", -0.05), ("_high", 0.05))
    },
)
PATH = table(
    steps=["displacement"] * 3 + ["velocity"] * 2,
    iteration=[0, 10, 1000, 0, 10],
    survival=[1e-4, 2e-4, 1e-3, 1e-4, 1e-4],
    residual=[1e-4, 1e-4, 1e-3, 1e-4, 1e-4],
)
FORMATIONS = table(
    problems=["leader, I"] * 2 + ["constrained, I"] * 2 + ["leader, II"] * 2,
    steps=["displacement"] * 6,
    iteration=[0, 100] * 3,
    gap_median=[1.0, 0.1, 0.5, 0.0, 2.0, 0.4],
    residual_median=[1e-2, 1e-4] * 3,
)
INFEASIBLE = table(
    policy=["constrained"] * 3 + ["leader"] * 3,
    step=[0, 1, 2] * 2,
    alive=[3.0, 2.5, 2.0, 3.0, 2.8, 2.1],
    infeasible=[2.0, 0.0, 1.0, 0.0, 0.0, 0.0],
)
HORIZONS = pd.DataFrame(
    product(("one", "two", "three", "four"), ("leader-mpc-3", "mine"), (8, 1, 3)),
    columns=["scenario", "policy", "horizon"],
).assign(
    success=lambda table: 0.5 + 0.01 * table["horizon"],
    success_low=0.45,
    success_high=0.6,
    infeasible=lambda table: 10.0 / table["horizon"],
)
FIGURES: dict[str, Callable[[], Figure]] = {
    "guide": lambda: guide_map(SCENARIO, GUIDE, [GUIDE.positions[::-1]]),
    "comparison": lambda: comparison_map(SCENARIO, {"one": GUIDE, "other": GUIDE}),
    "cost-to-go": lambda: cost_to_go_map(SCENARIO, COSTS, GUIDE),
    "swarm": lambda: swarm_map(SCENARIO, RUN, GUIDE),
    "formation": lambda: formation_chart(SCENARIO, RUN, GUIDE, corridors=True),
    "success": lambda: success_chart(SUMMARY, "mine"),
    "difference": lambda: difference_chart(PAIRED, "mine"),
    "arrival": lambda: arrival_chart(DISTRIBUTIONS, "mine"),
    "population": lambda: population_chart(DISTRIBUTIONS, 3, "mine"),
    "survival": lambda: survival_chart(DISTRIBUTIONS, "mine"),
    "lines": lambda: sweep_lines(sweep_table(), "n", "mine"),
    "many lines": lambda: sweep_lines(sweep_table(), "n", "mine", ["rho"]),
    "heat map": lambda: sweep_heat_map(sweep_table(), ["n", "rho"], "mine"),
    "profile": lambda: profile_chart({"a": PROFILE, "b": PROFILE}, "factor", "mine"),
    "bands": lambda: band_chart(PROFILE, (0.5 * PROFILE, PROFILE), "factor", "mine"),
    "ranking": lambda: ranking_chart(RANKING, "mine"),
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


PAPER = ("joint", "table 2", "scenarios", "sensitivity", "convergence", "infeasible", "mpc")


def text_of(fig: Figure) -> str:
    """All text of a figure."""
    return " ".join(text.get_text() for text in fig.findobj(match=Text)).replace("\n", " ")


def colors(*policies: str) -> list[str]:
    return [POLICIES[policy].color.lower() for policy in policies]


# --- every figure


@pytest.mark.parametrize(
    ("what", "name"),
    [(what, "column") for what in FIGURES]
    + [(what, "page") for what in ("guide", "formation", "profile")]
    + [(what, "slide") for what in ("guide", "formation", "profile", *PAPER)],
)
def test_figure_in_theme_has_its_width_and_fits(what: str, name: str) -> None:
    with theme(name):
        fig = FIGURES[what]()
    assert_fits(fig, name)


@pytest.mark.parametrize(
    ("what", "ending"), [("guide", "svg"), ("guide", "pdf"), ("success", "svg"), ("success", "png")]
)
def test_save_same_figure_gives_same_bytes(what: str, ending: str, tmp_path: Path) -> None:
    with theme("column"):
        files = [save(FIGURES[what](), tmp_path / f"{number}.{ending}") for number in (1, 2)]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_save_png_has_requested_resolution(tmp_path: Path) -> None:
    with theme("column"):
        save(FIGURES["guide"](), tmp_path / "guide.png", 300)
    with Image.open(tmp_path / "guide.png") as image:
        assert image.width == 1050


def test_column_theme_has_readable_font_sizes() -> None:
    with theme("column"):
        fig = FIGURES["guide"]()
    sizes = [text.get_fontsize() for text in fig.findobj(match=Text)]
    assert min(sizes) > 5.5


ONE_PANEL: dict[str, Callable[..., Figure]] = {
    "guide": lambda **options: guide_map(SCENARIO, GUIDE, **options),
    "comparison": lambda **options: comparison_map(SCENARIO, {"one": GUIDE}, **options),
    "cost-to-go": lambda **options: cost_to_go_map(SCENARIO, COSTS, GUIDE, **options),
    "swarm": lambda **options: swarm_map(SCENARIO, RUN, GUIDE, **options),
    "joint": lambda **options: joint_map(SCENARIO, RUN.positions, **options),
    "success": lambda **options: success_chart(SUMMARY, **options),
    "difference": lambda **options: difference_chart(PAIRED, **options),
    "arrival": lambda **options: arrival_chart(DISTRIBUTIONS, **options),
    "population": lambda **options: population_chart(DISTRIBUTIONS, 3, **options),
    "survival": lambda **options: survival_chart(DISTRIBUTIONS, **options),
    "lines": lambda **options: sweep_lines(sweep_table(), "n", **options),
    "profile": lambda **options: profile_chart({"a": PROFILE}, "factor", **options),
    "ranking": lambda **options: ranking_chart(RANKING, **options),
    "table 2": lambda **options: table_2_chart(TABLE_2, **options),
    "formation": lambda **options: formation_chart(SCENARIO, RUN, GUIDE, steps=[1], **options),
}
"""Figures of one panel, with options."""


def two_axes() -> tuple[Figure, list[Axes]]:
    """Axes side by side in a figure of the user's."""
    fig = Figure(figsize=(8, 3), layout="constrained")
    return fig, list(fig.subplots(1, 2))


@pytest.mark.parametrize("what", ONE_PANEL)
def test_figure_with_axes_is_drawn_into_them_alone(what: str) -> None:
    fig, (left, right) = two_axes()
    assert ONE_PANEL[what](ax=left, title="Mine") is fig
    assert left.has_data() or left.patches
    assert not right.has_data()
    if what not in ("profile", "formation"):  # their panels have titles of their own
        assert left.get_title() == "Mine"
    assert fig.get_suptitle() == ""
    assert not fig.legends
    fig.draw_without_rendering()
    box = fig.get_tightbbox()
    assert box.x0 > -0.02
    assert box.x1 < 8.02


@pytest.mark.parametrize("what", ONE_PANEL)
def test_title_replaces_the_default_and_none_removes_it(what: str) -> None:
    assert ONE_PANEL[what](title="Mine").get_suptitle() == "Mine"
    assert ONE_PANEL[what](title=None).get_suptitle() == ""


def test_names_with_dollar_signs_are_shown_as_they_are() -> None:
    odd = r"$\frac$"
    fig = profile_chart({odd: PROFILE.rename(columns={"fast": odd})}, "factor", r"$\alpha$")
    fig.canvas.draw()
    assert odd in text_of(fig)
    user, axes = two_axes()
    axes[0].set_ylabel(r"$\beta$")
    success_chart(SUMMARY.assign(policy=[odd, "b"]), ax=axes[0])
    user.draw_without_rendering()
    assert axes[0].yaxis.label.get_parse_math()


def test_figure_of_panels_with_one_axes_raises() -> None:
    fig, axes = two_axes()
    with pytest.raises(ValueError, match="ax has 1 axes for a figure of 2 panels; pass as many"):
        profile_chart({"a": PROFILE, "b": PROFILE}, "factor", ax=axes[0])
    assert profile_chart({"a": PROFILE, "b": PROFILE}, "factor", ax=axes) is fig
    assert [each.get_title() for each in axes] == ["a", "b"]


@pytest.mark.parametrize("what", ["guide", "success", "sensitivity", "mpc"])
@pytest.mark.parametrize("name", ["column", "page"])
def test_title_is_centred_over_the_panels(what: str, name: str) -> None:
    with theme(name):
        fig = FIGURES[what]()
    fig.draw_without_rendering()
    boxes = [axes.get_position() for axes in fig.axes if axes.get_visible()]
    title = next(text for text in fig.texts if text.get_text() == fig.get_suptitle())
    middle = (min(box.x0 for box in boxes) + max(box.x1 for box in boxes)) / 2
    assert title.get_position()[0] == pytest.approx(middle, abs=1e-6)


def test_maps_say_that_coinciding_paths_are_drawn_side_by_side() -> None:
    note = "paths that coincide\nare drawn side by side"
    apart = RUN.positions + np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 6.0]])
    assert note in legend_of(joint_map(SCENARIO, np.repeat(PATHS, 3, axis=1)))
    assert note not in legend_of(joint_map(SCENARIO, apart))


PATHS = GUIDE.positions[:, None]


@pytest.mark.parametrize("last", [3.1, 7.0, 40.0, 5e4])
def test_gap_chart_labels_ticks_of_every_range(last: float) -> None:
    iterates = table(
        solver=["fast"] * 3,
        iteration=[0, 2, int(last)],
        seconds=[2.1e-3, 2.5e-3, last * 1e-3],
        gap=[0.5, 0.4, 0.3],
        feasible=[True] * 3,
    )
    fig = gap_chart(iterates)
    fig.draw_without_rendering()
    for axis in (fig.axes[0].xaxis, fig.axes[1].xaxis, fig.axes[0].yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        shown = [t for t in ticks if t.label1.get_text() and low <= t.get_loc() <= high]
        assert len(shown) >= 2


def test_theme_with_unknown_name_raises() -> None:
    words = "'poster' is unknown; allowed: column, page, slide"
    with pytest.raises(ValueError, match=words), theme("poster"):
        pass
    assert FIGURES["success"]().get_size_inches()[0] == THEMES["page"].width


# --- maps


def test_guide_map_shows_guide_others_corridor_and_radars() -> None:
    fig = FIGURES["guide"]()
    assert legend_of(fig) == [
        "target",
        "radar",
        "other candidate paths",
        "corridor",
        f"guide, {GUIDE.arrival} steps",
        "initial positions",
    ]
    assert f"single-agent survival {GUIDE.survival:.3g}" in text_of(fig)
    lines = {line.get_label(): line for line in fig.axes[0].get_lines()}
    np.testing.assert_array_equal(
        np.transpose(lines[f"guide, {GUIDE.arrival} steps"].get_data()), GUIDE.positions
    )
    low, high = fig.axes[0].get_xlim()
    assert low < GUIDE.positions[:, 0].min()
    assert high > SCENARIO.target.center[0] + SCENARIO.target.radius


def test_guide_map_omits_guide_among_others() -> None:
    assert "other candidate paths" not in legend_of(guide_map(SCENARIO, GUIDE, [GUIDE.positions]))


def test_swarm_map_numbers_members_where_destroyed() -> None:
    fig = FIGURES["swarm"]()
    assert "2 of 3 alive after 3 steps" in text_of(fig)
    cross = next(line for line in fig.axes[0].get_lines() if line.get_label() == "destroyed")
    np.testing.assert_allclose(np.ravel(cross.get_data()), RUN.positions[2, 1], atol=1e-6)
    assert [text.get_text() for text in fig.axes[0].texts] == ["1"]
    paths = [patch for patch in fig.axes[0].patches if isinstance(patch, PathPatch)]
    assert [len(patch.get_path()) for patch in paths] == [4, 3, 4]  # up to where it was lost


def test_joint_map_with_long_title_fits() -> None:
    far = np.array([[-0.5, 0.5], [4.0, -5.7], [11.7, 2.4], [8.5, 6.3]])
    with theme("column"):
        fig = joint_map(SCENARIO, np.repeat(far[:, None], 3, axis=1), title="joint plan " * 5)
    assert_fits(fig, "column")


def test_swarm_map_close_losses_share_label() -> None:
    positions = RUN.positions.copy()
    alive = np.array([[True] * 3, [True] * 3, [True, False, True], [True, False, False]])
    for distance, labels in ((0.02, ["1, 2"]), (2.0, ["1", "2"])):
        positions[3, 2] = positions[2, 1] + [distance, 0.0]
        fig = swarm_map(SCENARIO, RunTrajectory(positions, alive, RUN.leaders))
        assert [text.get_text() for text in fig.axes[0].texts] == labels


def large_swarm() -> RunTrajectory:
    """Nine members, four of which are lost close to each other, and one elsewhere."""
    positions = np.zeros((3, 9, 2)) + np.arange(9)[:, None] * [0.3, 0.1]
    positions[:, :4] = [1.0, 1.0] + np.arange(4)[:, None] * [0.01, 0.0]
    alive = np.ones((3, 9), bool)
    alive[2, :5] = False
    return RunTrajectory(positions, alive, np.full(2, -1))


def test_crosses_of_close_losses_are_one_with_their_number() -> None:
    run = large_swarm()
    fig = swarm_map(SCENARIO, run)
    (crosses,) = markers(fig.axes[0], "X")
    assert len(np.ravel(crosses.get_xdata())) == 2
    assert sorted(text.get_text() for text in fig.axes[0].texts) == ["", "×4"]
    closeup = formation_chart(SCENARIO, run, steps=[2]).axes[0]
    assert "×4" in [text.get_text() for text in closeup.texts]
    moving = animate(SCENARIO, run)
    moving.shown.show(len(moving.shown.centers) - 1)
    assert len(markers(moving.shown.map, "X")) == 2
    assert "×4" in [text.get_text() for text in moving.shown.map.texts]


# --- charts


def test_policies_have_same_style_in_every_chart() -> None:
    bars = {bar.get_y() + bar.get_height() / 2: bar for bar in FIGURES["success"]().axes[0].patches}
    assert [to_hex(bars[k].get_facecolor()) for k in sorted(bars)] == colors("naive", "leader")
    for what in ("arrival", "population", "survival"):
        lines = {
            line.get_label().split(":")[0]: line for line in FIGURES[what]().axes[0].get_lines()
        }
        for name in ("naive", "leader"):
            assert lines[name].get_color() == POLICIES[name].color


def test_policy_styles_of_user_policies_are_distinct() -> None:
    names = ["mine", "yours", "naive", "theirs", "leader"]
    styles = policy_styles(names)
    assert len(set(styles.values())) == 5
    assert styles["naive"] == POLICIES["naive"]
    assert policy_styles(["mine"])["mine"] == styles["mine"]  # independent of the others
    ahead = policy_styles(["leader", "leader-mpc-3", "leader-mpc-5"])
    assert ahead["leader-mpc-3"] == policy_styles(["leader-mpc-7"])["leader-mpc-7"]
    assert len(set(ahead.values())) == 3
    assert set(policy_styles(map(str, range(50)))) == set(map(str, range(50)))


def test_success_chart_shows_success_and_interval() -> None:
    axes = FIGURES["success"]().axes[0]
    assert [bar.get_width() for bar in axes.patches] == [0.3, 0.7]
    assert [text.get_text() for text in axes.texts] == ["0.300", "0.700"]
    ends = [segment[:, 0] for lines in axes.collections for segment in lines.get_segments()]
    np.testing.assert_allclose(ends, [[0.2, 0.4], [0.6, 0.8]])
    assert axes.get_xlim()[0] == 0


def test_success_chart_without_runs_shows_bounds() -> None:
    bounds = pd.DataFrame(
        {"policy": ["a", "b"], "success_low": [0.5, 0.25], "success_high": [0.500001, 0.26]}
    )
    fig = success_chart(bounds)
    assert [text.get_text() for text in fig.axes[0].texts] == ["0.5000", "0.2500\nto 0.2600"]
    assert "exact distribution" in text_of(fig)


def test_difference_chart_shows_zero_and_both_names() -> None:
    axes = FIGURES["difference"]().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["naive − leader"]
    low, high = axes.get_xlim()
    assert low < -0.5 < 0 < high


def test_distribution_charts_draw_lower_bounds() -> None:
    for what, index in (("arrival", 0), ("survival", 1)):
        line = next(
            line
            for line in FIGURES[what]().axes[0].get_lines()
            if line.get_label().startswith("leader")
        )
        distribution = DISTRIBUTIONS[1]
        expected = (
            np.cumsum(distribution.arrival)
            if index == 0
            else 1 - distribution.population[:, 0] - distribution.residual_mass_before
        )
        np.testing.assert_allclose(line.get_ydata(), expected)


def test_survival_bounds_differ_by_residual_mass() -> None:
    low, high = DISTRIBUTIONS[1].any_alive
    np.testing.assert_allclose(high - low, DISTRIBUTIONS[1].residual_mass_before)
    assert (np.diff(high) <= 0).all()


# --- sweeps


def test_sweep_lines_omit_failed_points() -> None:
    containers = FIGURES["lines"]().axes[0].containers
    lines = {container.get_label(): container.lines[0] for container in containers}
    assert legend_of(FIGURES["lines"]()) == ["naive", "leader"]
    assert len(lines["leader"].get_ydata()) == 3
    assert len(lines["naive"].get_ydata()) == 4


def test_sweep_lines_of_two_parameters_have_panel_per_policy() -> None:
    fig = FIGURES["many lines"]()
    assert [axes.get_title() for axes in fig.axes] == ["naive", "leader"]
    assert legend_of(fig) == ["0.1", "0.2"]
    assert fig.legends[0].get_title().get_text() == "rho"


def test_heat_map_crosses_out_failed_points() -> None:
    panels = FIGURES["heat map"]().axes[:2]
    assert sorted(text.get_text() for text in panels[0].texts) == ["0.10", "0.20", "0.30", "0.40"]
    assert "×" in {text.get_text() for text in panels[1].texts}


# --- the paper reproduced, and horizons


def test_table_2_chart_has_marker_per_kind_and_colour_per_policy() -> None:
    axes = FIGURES["table 2"]().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["naive", "leader"]
    for marker, values in (("s", (0.3, 0.6)), ("D", (0.31, 0.64)), ("|", (0.3102, 0.6402))):
        drawn = markers(axes, marker)
        assert [line.get_xdata()[0] for line in drawn] == pytest.approx(values)
        assert [to_hex(line.get_color()) for line in drawn] == colors("naive", "leader")


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
    filled, hollow = markers(fig.axes[1], "D")
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
