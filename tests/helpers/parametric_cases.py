"""Small scenarios and CasADi policies for gradients."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw

STARTS = [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3), (0.1, -0.3)]
STEPS = 5
START = np.array([0.9, 0.1, 0.21, -0.05, 0.1] + [0.05, -0.05] * STEPS)
"""Parameters of `steering`, with which most members arrive."""
DIFFERENCE = 1e-5


@cache
def scene(n=3, **values):
    values = {"swarm__velocity": [1.2, 0.0]} | values
    return small(STARTS[:n], (2.0, 0.0), [(1.0, 0.8)], STEPS, **values)


@cache
def scene_with_collisions(n=3):
    collision = {"hazard__beta_1": 0.2, "hazard__beta_2": 6.0}
    return scene(n, hazard__kind="saturation+collision", **collision)


@cache
def guide(scenario):
    return csw.plan(scenario.believed, certify=False)


def steering(step, positions, previous_velocities, alive, parameters):
    """Towards the target, its own velocity, and the mean of the living, and an offset a step."""
    n = positions.shape[0]
    to_target = ca.repmat(ca.DM([[2.0, 0.0]]), n, 1) - positions
    mean = ca.mtimes(alive.T, positions) / ca.sum1(alive)
    to_mean = ca.repmat(mean, n, 1) - positions
    offset = ca.repmat(parameters[5 + 2 * step : 7 + 2 * step].T, n, 1)
    return (
        parameters[0] * to_target
        + parameters[1] * previous_velocities
        + (parameters[2] + parameters[3] * ca.sum1(alive)) * to_mean
        + parameters[4] * ca.sin(2 * positions) * ca.repmat(alive, 1, 2)
        + offset
    )


def steered(scenario, parameters=START):
    return csw.ParametricPolicy(steering, parameters, scenario)


def gradient(scenario, policy, parameters=None, tolerance=0.0, **options):
    """`success_gradient` without rounding."""
    options = {"aggregation_tol": 0.0, "guide": guide(scenario)} | options
    return csw.success_gradient(scenario, policy, parameters, tolerance, **options)


def assert_smooth(smooth):
    assert smooth, "there is a kink or a jump: choose other parameters"


def assert_equals_differences(scenario, policy, parameters, require=assert_smooth, **options):
    """Central differences in random directions and in the first parameters, to 1e-6.

    Differences of two lengths agree, unless there is a jump between: of 1e-11, it already changes
    the longer one by 1e-6.
    """
    found = gradient(scenario, policy, parameters, **options)
    rng = np.random.default_rng(0)
    directions = np.vstack([np.eye(len(parameters))[:5], rng.normal(size=(3, len(parameters)))])
    for direction in directions:
        quotients = []
        for length in (DIFFERENCE, DIFFERENCE / 10):
            high, low = (
                gradient(
                    scenario, policy, parameters + side * length * direction, **options
                ).objective
                for side in (1, -1)
            )
            require(abs(high + low - 2 * found.objective) < 1e-7)
            quotients.append((high - low) / (2 * length))
        require(abs(quotients[0] - quotients[1]) < 1e-6)
        assert found.gradient @ direction == pytest.approx(quotients[1], abs=1e-6)
