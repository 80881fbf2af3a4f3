"""Integrated velocities, reachability, and velocities along polylines."""

from __future__ import annotations

import numpy as np
import pytest

from casswarm.motion import integrate, remaining_distance, resample

START, GOAL = np.array([1.0, 2.0]), np.array([9.0, 8.0])  # ten apart


def test_integrate_several_agents_matches_each() -> None:
    velocities = np.random.default_rng(0).normal(size=(9, 3, 2))
    starts = np.array([START, GOAL, [0.5, -0.1]])
    paths = integrate(starts, velocities, 0.33)
    for member in range(3):
        path = integrate(starts[member], velocities[:, member], 0.33)
        np.testing.assert_array_equal(paths[:, member], path)


def test_remaining_distance_moves_along_both_axes() -> None:
    positions = np.array([[1.0, 2.0], [6.0, 2.0], [8.5, 7.5]])
    np.testing.assert_allclose(
        remaining_distance(positions, GOAL, 2.0), [np.hypot(6, 4), np.hypot(1, 4), 0]
    )


# --- resampling


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_resample_ends_at_end_of_polyline(steps: int) -> None:
    polyline = np.array([START, [3.0, 7.0], [6.0, 1.0], GOAL])
    velocities = resample(polyline, steps, 0.33)
    assert velocities.shape == (steps, 2)
    np.testing.assert_allclose(integrate(START, velocities, 0.33)[-1], GOAL, rtol=1e-12)


def test_resample_line_has_constant_velocity() -> None:
    velocities = resample(np.stack([START, GOAL]), 5, 0.5)
    np.testing.assert_allclose(velocities, np.tile((GOAL - START) / 2.5, (5, 1)), rtol=1e-12)


def test_resample_points_are_equidistant_on_polyline() -> None:
    corner = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]])  # length 6: two steps a unit
    path = integrate(corner[0], resample(corner, 12, 0.1), 0.1)
    expected = [[min(s, 3.0), max(s - 3.0, 0.0)] for s in np.arange(13) / 2]
    np.testing.assert_allclose(path, expected, atol=1e-12)
