"""Initial paths of the guide problem along polylines: where they lead, at what speed."""

from __future__ import annotations

import numpy as np
import pytest

from casswarm.planning.kinematics import integrate, resample

START, GOAL = np.array([1.0, 2.0]), np.array([9.0, 8.0])  # ten apart


def test_straight_is_the_line_from_start_to_goal() -> None:
    np.testing.assert_array_equal(np.stack([START, GOAL]), [START, GOAL])


# --- resampling


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_resampled_path_ends_where_the_polyline_ends(steps: int) -> None:
    polyline = np.array([START, [3.0, 7.0], [6.0, 1.0], GOAL])
    velocities = resample(polyline, steps, 0.33)
    assert velocities.shape == (steps, 2)
    np.testing.assert_allclose(integrate(START, velocities, 0.33)[-1], GOAL, rtol=1e-12)


def test_resampled_line_has_one_velocity() -> None:
    velocities = resample(np.stack([START, GOAL]), 5, 0.5)
    np.testing.assert_allclose(velocities, np.tile((GOAL - START) / 2.5, (5, 1)), rtol=1e-12)


def test_resampled_points_lie_on_the_polyline_at_equal_lengths() -> None:
    corner = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]])  # length 6: two steps a unit
    path = integrate(corner[0], resample(corner, 12, 0.1), 0.1)
    expected = [[min(s, 3.0), max(s - 3.0, 0.0)] for s in np.arange(13) / 2]
    np.testing.assert_allclose(path, expected, atol=1e-12)
