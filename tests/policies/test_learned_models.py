"""Learned models as policies, and what they observe."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scaled_scenarios import scaled
from small_scenarios import image, small, three_members

import casswarm as csw
from casswarm.policies import Observation

SMALL = three_members(swarm__velocity=[1.0, 0.2])
OBSERVATION = Observation.from_scenario(SMALL)
POSITION = OBSERVATION.slices["position"]


class Linear:
    """A model with weights."""

    def __init__(self) -> None:
        self.weights = np.zeros((OBSERVATION.size, 2), np.float32)
        self.weights[POSITION] = -1.6 * np.eye(2)
        self.calls: list[Any] = []

    def __call__(self, observations: Any) -> Any:
        self.calls.append(observations.shape)
        return observations @ self.weights


class Predictor(Linear):
    """A model as of Stable-Baselines3."""

    __call__ = None  # type: ignore[assignment]

    def predict(self, observation: Any, state: Any = None, deterministic: bool = False) -> Any:
        noise = 0.0 if deterministic else np.random.default_rng().normal()
        return observation @ self.weights + noise, state


@pytest.fixture(scope="module")
def guide() -> csw.Guide:
    return csw.plan(SMALL, certify=False)


def test_model_equals_the_function_that_it_computes(guide: csw.Guide) -> None:
    def by_hand(_step: int, positions: Any, *_: Any) -> Any:
        return -1.6 * (positions - np.array(SMALL.target.center)) / OBSERVATION.length

    model = csw.as_policy(Linear(), SMALL, name="model", dtype="float64")
    hand, found = (
        csw.evaluate(SMALL, policy, tolerance=1e-2, guide=guide) for policy in (by_hand, model)
    )
    np.testing.assert_allclose(found.success, hand.success, atol=1e-6)


def test_model_is_called_once_for_a_batch() -> None:
    model = Linear()
    policy = csw.as_policy(model, SMALL)
    state = np.zeros((7, 3, 2)), np.zeros((7, 3, 2)), np.ones((7, 3), bool)
    assert policy.velocities(0, *state).shape == (7, 3, 2)
    assert model.calls == [(7, 3, OBSERVATION.size)]


def test_predict_is_asked_for_deterministic_answers(guide: csw.Guide) -> None:
    model = csw.as_policy(Predictor(), SMALL)
    assert model.name == "Predictor"
    linear = csw.as_policy(Linear(), SMALL, name="Predictor")
    first, second = (
        csw.evaluate(SMALL, policy, tolerance=1e-3, guide=guide) for policy in (model, linear)
    )
    assert first.success == second.success


@pytest.mark.slow
def test_model_can_be_sent_to_workers(guide: csw.Guide) -> None:
    policy = csw.as_policy(Linear(), SMALL)
    one, two = (
        csw.simulate(SMALL, policy, runs=40, workers=workers, guide=guide).runs
        for workers in (1, 2)
    )
    assert one.equals(two)


@pytest.mark.slow
def test_torch_module_is_evaluated_as_it_was() -> None:
    torch = pytest.importorskip("torch")
    module = torch.nn.Sequential(
        torch.nn.Linear(OBSERVATION.size, 8),
        torch.nn.Tanh(),
        torch.nn.Dropout(),
        torch.nn.Linear(8, 2),
    )
    policy = csw.as_policy(module, SMALL)
    assert policy.name == "Sequential"
    state = np.full((4, 3, 2), 0.3), np.zeros((4, 3, 2)), np.ones((4, 3), bool)
    before = policy.velocities(0, *state)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(1.0)
    np.testing.assert_array_equal(policy.velocities(0, *state), before)  # also without dropout
    assert module.training
    double = csw.as_policy(module.double(), SMALL)
    assert double.function.observation.dtype == "float64"  # type: ignore[attr-defined]
    copied = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(copied.velocities(0, *state), before)


# --- observations


TWO = small([(0.0, 0.0), (3.0, 4.0)], (3.0, 0.0), [(1.0, 2.0)], 10)


def test_observation_of_two_members_is_as_documented() -> None:
    observation = Observation.from_scenario(TWO, "float64")
    assert observation.length == 4.0
    assert observation.size == 6 + 2 + 5
    positions = np.array([[[0.0, 1.0], [2.0, 4.0]]])
    velocities = np.array([[[2.0, 0.5], [-1.0, 0.0]]])
    both = observation(4, positions, velocities, np.array([[True, True]]))
    other = [1.0, 0.5, 0.75, -0.5, 0.0]
    np.testing.assert_allclose(both[0, 0], [1, 0.6, -0.75, 0.25, 1, 0.25, 0.25, 0.25, *other])
    one = observation(4, positions, velocities, np.array([[True, False]]))
    np.testing.assert_allclose(one[0, 0], [1, 0.6, -0.75, 0.25, 1, 0.25, 0.25, 0.25, *[0.0] * 5])
    assert not one[0, 1].any()


def test_slices_name_every_number_once() -> None:
    observation = Observation.from_scenario(csw.load_scenario("alley"))
    numbers = [k for part in observation.slices.values() for k in range(observation.size)[part]]
    assert numbers == list(range(observation.size))


@given(seed=st.integers(0, 2**32), scale=st.floats(0.01, 100.0), shift=st.floats(-50.0, 50.0))
def test_observation_is_invariant_to_units_and_origin(
    seed: int, scale: float, shift: float
) -> None:
    rng = np.random.default_rng(seed)
    positions, velocities = rng.normal(size=(2, 6, 2, 2))
    alive = rng.random((6, 2)) < 0.8

    other = image(scaled(TWO, scale), np.eye(2), shift=(scale * shift, scale * shift))
    steps = rng.integers(0, 10, 6)
    given_ = Observation.from_scenario(TWO, "float64")(steps, positions, velocities, alive)
    found = Observation.from_scenario(other, "float64")(
        steps, scale * (positions + shift), scale * velocities, alive
    )
    np.testing.assert_allclose(found, given_, atol=1e-9)


def test_single_precision_is_the_rounded_double_precision() -> None:
    rng = np.random.default_rng(1)
    state = rng.normal(size=(5, 2, 2)), rng.normal(size=(5, 2, 2)), np.ones((5, 2), bool)
    double = Observation.from_scenario(TWO, float)(0, *state)
    assert Observation.from_scenario(TWO, None).dtype == "float64"  # NumPy's default
    single = Observation.from_scenario(TWO, np.float32)(0, *state)
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, double.astype(np.float32))


class Follower:
    """A model that flies to the guide's reference."""

    def __init__(self, observation: Observation) -> None:
        self.part = observation.slices["guide"]
        self.gain = observation.length / SMALL.time.dt

    def __call__(self, observations: Any) -> Any:
        return self.gain * observations[..., self.part]


def test_observed_guide_is_the_offset_to_the_next_reference(guide: csw.Guide) -> None:
    observation = Observation.from_scenario(SMALL, "float64", guide=guide)
    numbers = [k for part in observation.slices.values() for k in range(observation.size)[part]]
    assert numbers == list(range(OBSERVATION.size + 2))
    low, high = observation.bounds()
    alive = np.array([[True, False, True]])
    for step in range(SMALL.n_steps + 1):
        state = SMALL.positions[None] + 0.1 * step, np.full((1, 3, 2), 0.1), alive
        (rows,) = found = observation(step, *state)
        expected = (guide.reference(step + 1) - state[0][0]) / observation.length
        np.testing.assert_allclose(rows[[0, 2], -2:], expected[[0, 2]], atol=1e-12)
        np.testing.assert_array_equal(
            rows[:, :-2], Observation.from_scenario(SMALL, float)(step, *state)[0]
        )
        assert not rows[1].any()
        assert ((low <= rows) & (rows <= high)).all()
        restored = observation.state(found)
        assert restored.steps == [step]
        np.testing.assert_allclose(restored.positions[alive], state[0][alive], atol=1e-12)


@pytest.mark.slow
def test_model_of_the_guide_is_the_same_policy_in_environments_and_studies(
    guide: csw.Guide,
) -> None:
    pytest.importorskip("gymnasium", reason="needs the extra rl")
    from casswarm.envs import SwarmVectorEnv

    env = SwarmVectorEnv(
        SMALL, 40, guide=guide, dtype="float64", observe_guide=True, autoreset_mode="Disabled"
    )
    model = Follower(env.batch.observation)
    observations, _ = env.reset(seed=0)
    assert env.observation_space.contains(observations)
    success: Any = np.zeros(40, bool)
    while not env.batch.ends.ended.all():
        observations, rewards, *_ = env.step(model(observations))
        success |= rewards == 1.0
    policy = csw.as_policy(model, SMALL, dtype="float64", observed_guide=guide)
    study = csw.simulate(SMALL, [policy], 40, seed=0, guide=guide)
    np.testing.assert_array_equal(study.runs["success"], success)
    assert 0 < success.sum() < 40

    def follow(step: int, positions: Any, *_: Any) -> Any:
        return (guide.reference(step + 1) - positions) / SMALL.time.dt

    by_hand = csw.evaluate(SMALL, follow, 1e-2, guide=guide).success
    np.testing.assert_allclose(csw.evaluate(SMALL, policy, 1e-2, guide=guide).success, by_hand)


def test_observed_guide_that_cannot_be_observed_raises(guide: csw.Guide) -> None:
    with pytest.raises(csw.PolicyError, match="plan a guide for this scenario"):
        Observation.from_scenario(small([(0.0, 0.0)], (4.0, 0.0), [(2.0, 2.0)], 12), guide=guide)
    with pytest.raises(csw.PolicyError, match="observed_guide is for a model"):
        csw.as_policy(lambda *state: 0 * state[1], observed_guide=guide)
