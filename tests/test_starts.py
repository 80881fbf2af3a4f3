"""Initial paths of the guide problem: where they lead, on which sides, at what speed."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import Array

from casswarm.guide import path_of, sides_of
from casswarm.starts import CLEARANCE, around, resampled, straight

START, GOAL = np.array([1.0, 2.0]), np.array([9.0, 8.0])  # ten apart
ALONG = np.array([0.8, 0.6])
LEFT = np.array([-0.6, 0.8])


def beside_the_line(*places: tuple[float, float]) -> Array:
    """Radars (k, 2) at distances along the line and to the left of it."""
    return np.array([START + along * ALONG + left * LEFT for along, left in places])


def ways(radars: Array) -> dict[str, Array]:
    found = list(around(START, GOAL, radars))
    assert len(dict(found)) == len(found)
    return dict(found)


def distance_to(polyline: Array, point: Array) -> float:
    """Of a point from the nearest of many points on a polyline."""
    fine = path_of(polyline[0], resampled(polyline, 4000, 1.0), 1.0)
    return float(np.hypot(*(fine - point).T).min())


def test_straight_is_the_line_from_start_to_goal() -> None:
    np.testing.assert_array_equal(straight(START, GOAL), [START, GOAL])


# --- ways around


@given(st.floats(0.05, 0.95), st.floats(-0.6, 0.6))
@settings(max_examples=60, deadline=None)
def test_each_way_around_one_radar_passes_it_on_the_side_of_its_name(
    along: float, left: float
) -> None:
    radar = beside_the_line((10 * along, 10 * left))
    found = ways(radar)
    assert set(found) == {"L", "R"}
    for name, polyline in found.items():
        assert sides_of(polyline, radar) == name


def test_way_leads_past_a_radar_with_clearance_beside_it() -> None:
    radar = beside_the_line((4.0, 0.5))
    corners = {name: polyline[1] for name, polyline in ways(radar).items()}
    clearance = CLEARANCE * 10
    np.testing.assert_allclose(corners["L"], beside_the_line((4.0, 0.5 - clearance))[0])
    np.testing.assert_allclose(corners["R"], beside_the_line((4.0, 0.5 + clearance))[0])


def test_way_stays_on_the_line_where_the_radar_is_far_from_it() -> None:
    radar = beside_the_line((4.0, 2.0))
    np.testing.assert_allclose(ways(radar)["L"][1], beside_the_line((4.0, 0.0))[0], atol=1e-12)


def test_ways_visit_the_radars_in_the_order_of_the_line() -> None:
    radars = beside_the_line((7.0, 0.2), (2.0, -0.1), (5.0, 0.3))
    for name, polyline in ways(radars).items():
        along = (polyline - START) @ ALONG
        assert (np.diff(along) > 0).all()
        assert sides_of(polyline, radars) == name


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_every_combination_of_sides_is_tried_around_up_to_four_radars(k: int) -> None:
    radars = beside_the_line(*[(2.0 * (i + 1), 0.1) for i in range(k)])
    assert set(ways(radars)) == {"".join(sides) for sides in product("LR", repeat=k)}


def test_many_radars_are_passed_as_the_line_passes_them_but_for_one_or_all() -> None:
    offsets = [0.3, -0.3, 0.2, 0.4, -0.1, -0.5]  # the line's own sides: LRLLRR
    radars = beside_the_line(*[(1.3 * (i + 1), left) for i, left in enumerate(offsets)])
    own = sides_of(straight(START, GOAL), radars)
    assert own == "LRLLRR"
    flipped = {own[:i] + "LR"[own[i] == "L"] + own[i + 1 :] for i in range(6)}
    assert set(ways(radars)) == {own, "LLLLLL", "RRRRRR", *flipped}


def test_every_way_goes_from_start_to_goal_and_keeps_off_well_separated_radars() -> None:
    radars = beside_the_line((3.0, 0.5), (7.0, -0.5))
    for polyline in ways(radars).values():
        np.testing.assert_array_equal(polyline[[0, -1]], [START, GOAL])
        assert min(distance_to(polyline, radar) for radar in radars) > 0.4


def test_nothing_leads_around_no_radar_or_nowhere() -> None:
    assert list(around(START, GOAL, np.empty((0, 2)))) == []
    assert list(around(START, START, beside_the_line((3.0, 0.5)))) == []


# --- resampling


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_resampled_path_ends_where_the_polyline_ends(steps: int) -> None:
    polyline = np.array([START, [3.0, 7.0], [6.0, 1.0], GOAL])
    velocities = resampled(polyline, steps, 0.33)
    assert velocities.shape == (steps, 2)
    np.testing.assert_allclose(path_of(START, velocities, 0.33)[-1], GOAL, rtol=1e-12)


def test_resampled_line_has_one_velocity() -> None:
    velocities = resampled(straight(START, GOAL), 5, 0.5)
    np.testing.assert_allclose(velocities, np.tile((GOAL - START) / 2.5, (5, 1)), rtol=1e-12)


def test_resampled_points_lie_on_the_polyline_at_equal_lengths() -> None:
    corner = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]])  # length 6: two steps a unit
    path = path_of(corner[0], resampled(corner, 12, 0.1), 0.1)
    expected = [[min(s, 3.0), max(s - 3.0, 0.0)] for s in np.arange(13) / 2]
    np.testing.assert_allclose(path, expected, atol=1e-12)
