"""Figures of small data: contents, sizes, and reproducible files."""

from __future__ import annotations

from collections.abc import Callable
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
    sweep_table,
)
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.text import Text
from PIL import Image

from casswarm.chain import RunTrajectory
from casswarm.figures import (
    THEMES,
    arrival_chart,
    band_chart,
    comparison_map,
    cost_to_go_map,
    difference_chart,
    formation_chart,
    guide_map,
    joint_map,
    population_chart,
    profile_chart,
    ranking_chart,
    save,
    success_chart,
    survival_chart,
    swarm_map,
    sweep_heat_map,
    sweep_lines,
    theme,
)
from casswarm.figures.success import POLICIES, policy_styles
from casswarm.grid import CostToGoMap

PROFILE = pd.DataFrame({"fast": [0.5, 1.0], "slow": [0.0, 0.5]}, index=[1.0, 4.0])
RANKING = pd.DataFrame(
    {
        "solver": ["fast", "projected-gradient"],
        "mean_ms": [1.5, 400.0],
        "mean_ms_low": [1.0, np.nan],
        "mean_ms_high": [2.0, np.nan],
        "rank": [1.0, 2.0],
        "probability": [0.93, np.nan],
    }
)
COSTS = CostToGoMap(
    0,
    np.array([-2.0, -2.0]),
    np.array([5.0, 4.0]),
    np.linspace(0, 1, 9).reshape(3, 3),
    np.array([[0.0, 0.0], [1.0, 1.0]]),
    np.array([[1.0, 0.0], [0.0, 0.0]]),
)
FIGURES: dict[str, Callable[[], Figure]] = {
    "guide": lambda: guide_map(SCENARIO, GUIDE, [GUIDE.positions[::-1]]),
    "comparison": lambda: comparison_map(SCENARIO, {"one": GUIDE, "other": GUIDE}),
    "cost-to-go": lambda: cost_to_go_map(SCENARIO, COSTS, GUIDE),
    "swarm": lambda: swarm_map(SCENARIO, RUN, GUIDE, "mine"),
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
}


def legend_of(fig: Figure) -> list[str]:
    legends = [*fig.legends, *(a.get_legend() for a in fig.axes if a.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def text_of(fig: Figure) -> str:
    """All text of a figure."""
    return " ".join(text.get_text() for text in fig.findobj(match=Text)).replace("\n", " ")


# --- every figure


@pytest.mark.parametrize(
    ("what", "name"),
    [(what, "column") for what in FIGURES]
    + [(what, name) for what in ("guide", "formation", "profile") for name in ("page", "slide")],
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


# --- charts


def test_policies_have_same_style_in_every_chart() -> None:
    bars = {bar.get_y() + bar.get_height() / 2: bar for bar in FIGURES["success"]().axes[0].patches}
    assert [to_hex(bars[k].get_facecolor()) for k in sorted(bars)] == [
        POLICIES[name].color.lower() for name in ("naive", "leader")
    ]
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
