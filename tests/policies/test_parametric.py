"""Parametric policies are policies: feasible, batched, picklable, evaluated and simulated."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from parametric_cases import START, guide, scene, steered, steering

import casswarm as csw
from casswarm.errors import PolicyCallError, PolicyError


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


def test_decision_of_batch_equals_single_states():
    policy = steered(scene(3))
    state = states(8, seed=1)
    together = policy.velocities(3, *state)
    for b in range(8):
        alone = policy.velocities(3, *(part[b] for part in state))
        np.testing.assert_array_equal(together[b], alone)


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


def test_simulated_success_agrees_with_exact_one():
    policy = steered(scene(3))
    exact = csw.evaluate(scene(3), policy, 1e-6, guide=guide(scene(3))).success
    study = csw.simulate(scene(3), [policy], 2000, guide=guide(scene(3)))
    rate = float(study.summary["success"][0])
    assert abs(rate - exact.low) < 4 * np.sqrt(0.25 / 2000)
    assert study.summary["policy"][0] == "parametric"
    assert study.summary["saturated"][0] == 0


def test_parameters_are_copied_and_read_only():
    values = START.copy()
    policy = csw.ParametricPolicy(steering, values, scene(3))
    values[:] = 0
    np.testing.assert_array_equal(policy.parameters, START)
    with pytest.raises(ValueError, match="read-only"):
        policy.parameters[0] = 1.0
    assert policy.with_parameters(values).parameters[0] == 0.0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ([[1.0]], r"shape \(1, 1\); expected \(p,\)"),
        ([], r"shape \(0,\)"),
        ([np.nan], "NaN or infinity"),
        ("many", "expected a vector of numbers"),
    ],
)
def test_wrong_parameters_raise(parameters, message):
    with pytest.raises(PolicyError, match=message):
        csw.ParametricPolicy(steering, parameters, scene(3))


def test_wrong_functions_raise():
    with pytest.raises(PolicyError, match="not a function of"):
        csw.ParametricPolicy(3, [1.0], scene(3))
    with pytest.raises(PolicyCallError, match=r"shape \(2, 3\) at step 0; expected \(3, 2\)"):
        csw.ParametricPolicy(lambda *state: state[1].T, [1.0], scene(3))
    with pytest.raises(PolicyCallError, match=r"failed at step 0 .*IndexError: no such"):
        csw.ParametricPolicy(failing, [1.0], scene(3))
    with pytest.raises(PolicyError, match="framework = 'numpy'; allowed: casadi, jax, torch"):
        csw.ParametricPolicy(steering, START, scene(3), framework="numpy")
    infinite = csw.ParametricPolicy(lambda *state: state[1] / 0, [1.0], scene(3))
    with pytest.raises(PolicyCallError, match="velocities must be finite"):
        infinite.velocities(0, *states(2))
    with pytest.raises(PolicyError, match="is for 3 members, not 1"):
        steered(scene(3)).velocities(0, np.zeros((1, 2)), np.zeros((1, 2)), [True])


def failing(*_):
    raise IndexError("no such")
