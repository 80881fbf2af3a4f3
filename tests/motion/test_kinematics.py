"""Integrated velocities, reachability, velocities along polylines, and derivatives of a step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from casswarm.motion import Motion, integrate, remaining_distance, resample

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


# --- derivatives of the projection on velocities that limits of motion allow

MOTION = Motion(v_max=2.0, a_max=0.5, dt=0.33)
STEP = 1e-6
numbers = st.floats(-3, 3, width=32)


def project(commanded, previous):
    return MOTION.sets(previous).project(commanded)


def one_sided(commanded, previous, side):
    """Difference quotients (4, 2): by the commanded, then by the previous components."""
    base, rows = project(commanded, previous), []
    for which in (0, 1):
        for axis in (0, 1):
            moved = [commanded.copy(), previous.copy()]
            moved[which][axis] += side * STEP
            rows.append((project(*moved) - base) * side / STEP)
    return np.array(rows)


def adjoint(commanded, previous, seeds):
    projected = project(commanded, previous)
    return np.concatenate(MOTION.project_adjoint(commanded, previous, projected, seeds))


@given(st.tuples(numbers, numbers), st.tuples(numbers, numbers), st.tuples(numbers, numbers))
def test_project_adjoint_equals_differences(commanded, previous, seeds):
    commanded, seeds = np.array(commanded), np.array(seeds)
    previous = np.clip(previous, -1.999, 1.999)
    forward, backward = (one_sided(commanded, previous, side) for side in (1, -1))
    assume(np.abs(forward - backward).max() < 1e-3)  # not at a kink
    central = 0.5 * (forward + backward) @ seeds
    scale = 1 + np.abs(forward).max()
    np.testing.assert_allclose(adjoint(commanded, previous, seeds), central, atol=1e-4 * scale)


@pytest.mark.parametrize(
    ("commanded", "previous", "expected"),
    [
        ([0.1, 0.2], [0.0, 0.0], [1, 1, 0, 0]),  # inside: the identity
        ([3.0, 0.2], [1.9, 0.0], [0, 1, 0, 0]),  # at the side of the box
        ([3.0, 3.0], [1.9, 1.9], [0, 0, 0, 0]),  # at its corner
        ([1.5, 0.0], [0.0, 0.0], [0, 0.5**0.5 / 1.5, 1, 1 - 0.5**0.5 / 1.5]),  # on the circle
        ([9.0, 3.0], [2.0, 0.0], [0, 0, 0, 1]),  # where the circle crosses the side
    ],
)
def test_project_adjoint_of_each_case_is_known(commanded, previous, expected):
    seeds = np.ones(2)
    got = adjoint(np.array(commanded), np.array(previous), seeds)
    np.testing.assert_allclose(got, expected, atol=1e-12)
