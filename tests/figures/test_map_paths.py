"""Paths of members on maps: side by side, close up, with labels clear of landmarks; layout."""

from __future__ import annotations

import numpy as np
import pytest
from figure_cases import GUIDE, PATH, RUN, SCENARIO
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import PathPatch
from matplotlib.quiver import Quiver

from casswarm._util.figure_style import MEMBERS
from casswarm.chain import RunTrajectory
from casswarm.figures import cost_to_go_map, formation_chart, joint_map, swarm_map, theme
from casswarm.figures.animation import between
from casswarm.figures.maps import LabelPlaces
from casswarm.figures.member_paths import free_place, joining_window, side_shifts
from casswarm.grid import CostToGoMap

CORNERS = np.array([[0.0, 0.0], [10.0, 6.0]])


def shared() -> RunTrajectory:
    """Three members that are on one path after the first step."""
    positions = np.repeat(between(PATH, 5)[:, None], 3, axis=1)
    positions[0] += [[0.0, 0.0], [-0.2, 0.2], [-0.2, -0.2]]
    alive = np.ones(positions.shape[:2], bool)
    return RunTrajectory(positions, alive, np.zeros(len(positions) - 1, int))


def colored_pixels(fig: Figure) -> dict[str, int]:
    """Numbers of pixels in the colours of the first three members."""
    fig.canvas.draw()
    pixels = np.asarray(fig.canvas.buffer_rgba())[..., :3].reshape(-1, 3)  # type: ignore[attr-defined]
    colors, counts = np.unique(pixels, axis=0, return_counts=True)
    found = {to_hex(color / 255).upper(): int(n) for color, n in zip(colors, counts, strict=True)}
    return {color: found.get(color, 0) for color in MEMBERS[:3]}


def test_side_shifts_of_shared_path_are_neighbouring_and_centred() -> None:
    apart = PATH + np.array([0.0, 5.0])
    shifts = side_shifts([PATH, apart, PATH[:3], PATH], 0.01)
    np.testing.assert_array_equal(shifts[0], [-1, -1, -1, -0.5, -0.5])  # the third ends before
    np.testing.assert_array_equal(shifts[1], 0)
    np.testing.assert_array_equal(shifts[2], 0)
    np.testing.assert_array_equal(shifts[3], [1, 1, 1, 0.5, 0.5])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["column", "page", pytest.param("slide", marks=pytest.mark.slow)])
def test_swarm_map_with_shared_path_shows_every_member(name: str) -> None:
    with theme(name):
        fig = swarm_map(SCENARIO, shared())
    fig.set_dpi(200)
    counts = list(colored_pixels(fig).values())
    assert min(counts) > 0.5 * max(counts)


def test_swarm_map_has_closeup_of_where_paths_join() -> None:
    run = shared()
    fig = swarm_map(SCENARIO, run)
    inset = fig.axes[0].child_axes[-1]
    low, high = np.transpose([inset.get_xlim(), inset.get_ylim()])
    assert (run.positions[:2] > low).all()
    assert (run.positions[:2] < high).all()
    fig.draw_without_rendering()
    placed = inset.get_window_extent()
    points = np.vstack([run.positions.reshape(-1, 2), SCENARIO.hazard.radar_positions])
    assert not any(placed.contains(*point) for point in fig.axes[0].transData.transform(points))


def test_joining_window_of_paths_that_never_join_is_none() -> None:
    assert joining_window([PATH, PATH + np.array([0.0, 1.0])]) is None
    assert joining_window([PATH, PATH]) is None


def test_free_place_avoids_points_and_is_near_the_last() -> None:
    points = np.array([[9.0, 5.0], [9.0, 1.0], [5.0, 3.0], [1.0, 1.0]])
    place = free_place(*CORNERS, 2.0, points)
    assert place is not None
    assert (np.abs(points - (place + 1.0)).max(axis=1) > 1.0).all()
    assert np.hypot(*(place + 1.0 - points[-1])) < 3.0
    grid = np.stack(np.meshgrid(np.arange(11.0), np.arange(7.0)), axis=-1).reshape(-1, 2)
    assert free_place(*CORNERS, 2.0, grid) is None


def test_label_places_avoid_radars_target_paths_and_labels() -> None:
    radars, target = SCENARIO.hazard.radar_positions, np.asarray(SCENARIO.target.center)
    for point in (radars[0] + np.array([-0.3, 0.2]), target - np.array([0.0, 0.5])):
        places = LabelPlaces(SCENARIO, [point + np.outer(np.arange(-3, 4), [0.1, 0.0])], 8.0)
        axes = Axes(Figure(), (0, 0, 1, 1))
        for text in ("1", "2"):
            places.add(axes, text, point)
        one, two = places.centers[-2:]
        assert np.hypot(*(one - two)) > 0.7 * places.distance
        for label in (one, two):
            assert np.hypot(*(label - radars).T).min() > 0.7 * places.distance
            assert np.hypot(*(label - target)) > SCENARIO.target.radius


def test_joint_map_legend_shows_lines_as_drawn() -> None:
    run = shared()
    fig = joint_map(SCENARIO, run.positions, np.full(run.alive.shape, 0.5))
    patches = [patch for patch in fig.axes[0].patches if isinstance(patch, PathPatch)]
    lines = [line for line in fig.legends[0].get_lines() if line.get_linestyle() == "-"]
    assert [line.get_linewidth() for line in lines] == [p.get_linewidth() for p in patches]
    assert [to_hex(line.get_color()) for line in lines] == [
        to_hex(patch.get_edgecolor()) for patch in patches
    ]


def test_cost_to_go_map_arrows_are_outlined() -> None:
    axis = np.arange(3.0)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    corners = np.array([-0.5, -0.5]), np.array([2.5, 2.5])
    velocities = np.tile([1.0, 0.0], (9, 1))
    fig = cost_to_go_map(
        SCENARIO, CostToGoMap(0, *corners, np.full((3, 3), 0.9), grid, velocities), GUIDE
    )
    arrows = next(item for item in fig.axes[0].collections if isinstance(item, Quiver))
    assert to_hex(arrows.get_facecolor()[0]) == "#ffffff"
    assert to_hex(arrows.get_edgecolor()[0]) == "#222222"
    np.testing.assert_allclose(np.hypot(arrows.U, arrows.V), 0.7)  # of the distance of arrows


@pytest.mark.parametrize("name", ["column", "page"])
def test_maps_fill_their_places_after_few_layouts(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    layouts: list[Figure] = []
    execute = ConstrainedLayoutEngine.execute

    def counted(engine: ConstrainedLayoutEngine, fig: Figure) -> object:
        layouts.append(fig)
        return execute(engine, fig)

    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", counted)
    with theme(name):
        figures = [swarm_map(SCENARIO, RUN, GUIDE), formation_chart(SCENARIO, RUN, GUIDE)]
        for fig in figures:
            fig.canvas.draw()
    assert max(map(layouts.count, figures)) <= 2
    for fig in figures:
        axes = fig.axes[0]
        wide, high = fig.get_size_inches() * axes.get_position(original=True).size
        (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
        assert wide / high == pytest.approx((east - west) / (north - south), rel=0.01)
