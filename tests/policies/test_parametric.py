"""Parametric policies are policies: feasible, batched, picklable, evaluated and simulated."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from parametric_cases import START, scene, steered, steering

import casswarm as csw


def states(batch, seed=0):
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, 3)) < 0.8
    living = alive[..., None]
    positions, previous = rng.normal(size=(2, batch, 3, 2))
    return positions * living, np.clip(previous, -2, 2) * living, alive


def by_hand(step, positions, previous, alive, p):
    living = alive[..., None]
    mean = (positions * living).sum(1, keepdims=True) / living.sum(1, keepdims=True)
    return (
        p[0] * (np.array([2.0, 0.0]) - positions)
        + p[1] * previous
        + (p[2] + p[3] * living.sum(1, keepdims=True)) * (mean - positions)
        + p[4] * np.sin(2 * positions)
        + p[5 + 2 * step : 7 + 2 * step]
    )


def test_velocities_are_projections_of_function():
    policy = steered(scene(3))
    positions, previous, alive = states(2500)
    some = alive.any(axis=1)
    positions, previous, alive = positions[some], previous[some], alive[some]
    velocities = policy.velocities(2, positions, previous, alive)
    commanded = by_hand(2, positions, previous, alive, START)
    sets = policy.motion.sets(previous)
    np.testing.assert_allclose(velocities[alive], sets.project(commanded)[alive], atol=1e-12)
    assert sets.violation(velocities)[alive].max() < 1e-12
    assert (sets.violation(commanded)[alive] > 0).any()


def test_casadi_function_is_a_policy():
    step, p = ca.MX.sym("step"), ca.MX.sym("p", len(START))
    x, v, alive = ca.MX.sym("x", 3, 2), ca.MX.sym("v", 3, 2), ca.MX.sym("alive", 3)
    function = ca.Function("steering", [step, x, v, alive, p], [steering(0, x, v, alive, p)])
    policy = csw.ParametricPolicy(function, START, scene(3))
    np.testing.assert_allclose(
        policy.velocities(0, *states(9)), steered(scene(3)).velocities(0, *states(9)), atol=1e-13
    )


class Unhashable:
    __hash__ = None

    def __call__(self, *state):
        return steering(*state)


def test_callable_need_not_be_hashable():
    policy = csw.ParametricPolicy(Unhashable(), START, scene(3))
    expected = steered(scene(3)).velocities(0, *states(9))
    np.testing.assert_array_equal(policy.velocities(0, *states(9)), expected)


def test_parameters_are_copied_and_read_only():
    values = START.copy()
    policy = csw.ParametricPolicy(steering, values, scene(3))
    values[:] = 0
    np.testing.assert_array_equal(policy.parameters, START)
    with pytest.raises(ValueError, match="read-only"):
        policy.parameters[0] = 1.0
    assert policy.with_parameters(values).parameters[0] == 0.0
