"""Policies in JAX and PyTorch are those in CasADi: success, gradient, errors."""

from __future__ import annotations

from itertools import count

import cloudpickle
import numpy as np
import pytest
from parametric_cases import (
    START,
    assert_equals_differences,
    gradient,
    scene,
    scene_with_collisions,
    steered,
)

import casswarm as csw
from casswarm.errors import PolicyCallError

ARRAYS = {"jax": "jax.numpy", "torch": "torch"}
FEATURES, HIDDEN = 5, 4


@pytest.fixture(scope="module", params=ARRAYS)
def framework(request):
    pytest.importorskip(request.param)
    return request.param


@pytest.fixture(scope="module")
def xp(framework):
    return pytest.importorskip(ARRAYS[framework])


@pytest.fixture(scope="module")
def steering(xp):
    """`parametric_cases.steering` in the framework."""

    def steering(step, positions, previous_velocities, alive, parameters):
        living = alive[:, None] * 1.0
        mean = (living * positions).sum(0) / living.sum()
        return (
            parameters[0] * (xp.asarray([2.0, 0.0]) - positions)
            + parameters[1] * previous_velocities
            + (parameters[2] + parameters[3] * living.sum()) * (mean - positions)
            + parameters[4] * xp.sin(2 * positions) * living
            + parameters[5:].reshape(-1, 2)[step]
        )

    return steering


def states(batch, n):
    """Positions and previous velocities (B, n, 2), and the living, one in each state at least."""
    rng = np.random.default_rng(5)
    alive = rng.random((batch, n)) < 0.7
    alive[~alive.any(axis=1), 0] = True
    positions, previous = rng.uniform(-1.5, 1.5, (2, batch, n, 2)) * alive[..., None]
    return positions, previous, alive


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 3])
def test_success_and_gradient_equal_those_in_casadi(framework, steering, n):
    scenario = scene_with_collisions(n)
    policy = csw.ParametricPolicy(steering, START, scenario, framework=framework)
    found, expected = (
        gradient(scenario, of, arrival_smoothing=0.2) for of in (policy, steered(scenario))
    )
    assert found.states == expected.states
    assert found.success.low == pytest.approx(expected.success.low, abs=1e-10)
    assert found.objective == pytest.approx(expected.objective, abs=1e-10)
    assert np.abs(expected.gradient).max() > 1e-3
    np.testing.assert_allclose(found.gradient, expected.gradient, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_gradient_of_network_equals_central_differences(framework, xp):
    def network(_step, positions, previous_velocities, alive, parameters):
        first, second = parameters[: FEATURES * HIDDEN], parameters[FEATURES * HIDDEN :]
        count = alive.sum() + 0.0 * positions[:, :1]
        features = xp.concatenate([positions, previous_velocities, count], 1)
        hidden = xp.tanh(features @ first.reshape(FEATURES, HIDDEN))
        return 1.5 * (xp.asarray([2.0, 0.0]) - positions) + hidden @ second.reshape(HIDDEN, 2)

    values = 0.2 * np.random.default_rng(4).normal(size=(FEATURES + 2) * HIDDEN)
    policy = csw.ParametricPolicy(network, values, scene(2), framework=framework)
    found = gradient(scene(2), policy, arrival_smoothing=0.3)
    assert np.abs(found.gradient).max() > 1e-3
    assert_equals_differences(scene(2), policy, values, arrival_smoothing=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 5, 1024, 1500])
def test_batch_equals_that_in_casadi(framework, steering, batch):
    """Batches of any size, padded and in chunks, with the sum of derivatives for parameters."""
    given, rng = states(batch, 3), np.random.default_rng(6)
    policy = csw.ParametricPolicy(steering, START, scene(3), framework=framework)
    expected = steered(scene(3))
    np.testing.assert_allclose(
        policy.velocities(2, *given), expected.velocities(2, *given), rtol=0, atol=1e-12
    )
    seeds, weights = rng.normal(size=(batch, 3, 2)), rng.random(batch)
    found = policy.adjoint(2, given, seeds, weights)
    for part, other in zip(found, expected.adjoint(2, given, seeds, weights), strict=True):
        np.testing.assert_allclose(part, other, rtol=1e-11, atol=1e-11)


@pytest.mark.slow
def test_policy_is_evaluated_and_survives_pickling(framework, steering):
    policy = csw.ParametricPolicy(steering, START, scene(3), framework=framework)
    copy = cloudpickle.loads(cloudpickle.dumps(policy))
    given = states(9, 3)
    np.testing.assert_array_equal(copy.velocities(1, *given), policy.velocities(1, *given))
    found, expected = (csw.evaluate(scene(3), of).success for of in (copy, steered(scene(3))))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_what_is_destroyed_has_no_influence(framework, xp):
    """Not even where the function has no number for the destroyed."""

    def reciprocal(_step, positions, _previous_velocities, alive, parameters):
        return parameters[0] / xp.where(alive[:, None], 1.0 + positions**2, 0.0)

    policy = csw.ParametricPolicy(reciprocal, [1.0], scene(2), framework=framework)
    state = np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), np.array([[True, False]])
    np.testing.assert_array_equal(policy.commanded(0, *state), [[[1.0, 1.0], [0.0, 0.0]]])


@pytest.mark.slow
def test_errors_are_those_in_casadi(framework, xp):
    def policy(function):
        return csw.ParametricPolicy(function, [1.2], scene(2), framework=framework)

    with pytest.raises(PolicyCallError, match=r"shape \(2,\) at step 0; expected \(2, 2\)"):
        policy(lambda *state: state[1][0] * state[-1])
    with pytest.raises(PolicyCallError, match=r"failed at step 0: .*test_gradient_frameworks.py:"):
        policy(lambda *state: state[1] + state[2][:, :1] @ state[1])
    with pytest.raises(PolicyCallError, match="failed at step 0"):
        policy(lambda *_: None)
    with pytest.raises(PolicyCallError, match="velocities must be finite"):
        gradient(scene(2), policy(lambda *state: state[1] / 0.0))
    with pytest.raises(PolicyCallError, match="derivative at step 4 that is not finite"):
        gradient(scene(2), policy(lambda *state: state[-1][0] + 0.01 * xp.sqrt(abs(state[1]))))


@pytest.mark.slow
def test_jax_function_is_traced_for_few_sizes_and_once_for_all_steps():
    jnp = pytest.importorskip("jax.numpy")
    traced = []

    def straight(step, positions, _previous_velocities, _alive, parameters):
        traced.append(step)
        return parameters[0] * jnp.ones_like(positions) + 0.0 * step

    policy = csw.ParametricPolicy(straight, [1.0], scene(1), framework="jax")
    for step in range(4):
        for batch in range(1, 17):
            policy.with_parameters([step]).velocities(step, *states(batch, 1))
    assert len(traced) == 5  # 1, 2, 4, 8 and 16 states
    assert jnp.ones(1).dtype == "float32"  # elsewhere


@pytest.mark.slow
def test_policy_with_memory_is_refused_by_every_study():
    torch, calls = pytest.importorskip("torch"), count()

    def remembering(step, positions, previous_velocities, alive, parameters):  # noqa: ARG001
        return parameters * positions + 0.1 * next(calls)

    policy = csw.ParametricPolicy(remembering, [-0.1], scene(), framework="torch")
    for study in (csw.success_gradient, csw.evaluate, csw.simulate):
        with pytest.raises(PolicyCallError, match="answers the same state differently at step"):
            study(scene(), policy)
    assert torch.is_grad_enabled()
