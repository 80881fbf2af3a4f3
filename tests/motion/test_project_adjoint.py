"""Derivatives of the projection on the velocities that limits of motion allow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from casswarm.motion import Motion

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
