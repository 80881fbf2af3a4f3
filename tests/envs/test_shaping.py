"""Potential-based shaping changes every return by the same constant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from env_cases import outcomes
from hypothesis import given
from hypothesis import strategies as st
from small_scenarios import patrolled, three_members

import casswarm as csw
from casswarm.envs import SwarmParallelEnv, SwarmVectorEnv
from casswarm.envs.batch import risk_table
from casswarm.envs.step_kernels import risk_to_go, write_potentials
from casswarm.grid import ValueFunction

SMALL = three_members(swarm__velocity=[1.0, 0.2])


def potentials(scenario: csw.Scenario, steps: Any, positions: Any, alive: Any) -> Any:
    found, ended = np.empty(len(alive)), np.zeros(len(alive), bool)
    table = risk_table(scenario)
    write_potentials(table, np.array(steps), np.array(positions), np.array(alive), ended, found)
    return found


def test_shaped_return_differs_by_the_initial_potential() -> None:
    def erratic(step: int, positions: Any, _: Any, alive: Any) -> Any:
        return alive[..., None] * (np.array([1.2, 0.3]) + 2.0 * np.sin(9.0 * positions + step))

    env = SwarmVectorEnv(SMALL, 40, shaping=True)
    table = outcomes(env, csw.as_policy(erratic), seed=2, episodes=2)
    initial = potentials(SMALL, [0], [SMALL.positions], [[True] * 3])[0]
    assert 0.1 < initial < 1.0
    np.testing.assert_allclose(table["returns"], table["success"] - initial, atol=1e-12)
    assert len(set(table["survivors"])) > 1


@given(st.floats(0.5, 1.0))
def test_discounted_shaped_return_differs_by_the_initial_potential(discount: float) -> None:
    shaped = SwarmVectorEnv(SMALL, 20, shaping=True, discount=discount, autoreset_mode="Disabled")
    plain = SwarmVectorEnv(SMALL, 20, autoreset_mode="Disabled")
    shaped.reset(seed=0)
    plain.reset(seed=0)
    differences, running = np.zeros(20), np.ones(20, bool)
    actions = np.tile([1.0, 0.2], (20, 3, 1))
    for step in range(SMALL.n_steps):
        rewards, ended = shaped.step(actions)[1:3]
        differences += discount**step * running * (rewards - plain.step(actions)[1])
        running &= ~ended
        for env in (shaped, plain):
            if ended.any():
                env.reset(options={"reset_mask": ended})
    initial = potentials(SMALL, [0], [SMALL.positions], [[True] * 3])[0]
    np.testing.assert_allclose(differences, -initial, atol=1e-12)


@given(st.sampled_from([0.9, 1.0]), st.integers(0, 10**6))
def test_additions_to_every_agents_reward_sum_to_the_initial_potential(
    discount: float, seed: int
) -> None:
    deadly = SMALL.with_values({"hazard.alpha_1": 40.0})
    env = SwarmParallelEnv(deadly, shaping=True, discount=discount)
    plain = SwarmParallelEnv(deadly)
    env.reset(seed=seed)
    plain.reset(seed=seed)
    sums = dict.fromkeys(env.possible_agents, 0.0)
    for step in range(deadly.n_steps):
        actions = {agent: np.array([1.0, 0.2]) for agent in env.agents}
        rewards, expected = env.step(actions)[1], plain.step(actions)[1]
        for agent, reward in rewards.items():
            sums[agent] += discount**step * (reward - expected[agent])
        if not env.agents:
            break
    initial = potentials(deadly, [0], [deadly.positions], [[True] * 3])[0]
    np.testing.assert_allclose(list(sums.values()), -initial, atol=1e-12)


@pytest.mark.parametrize("velocity", [(1.0, 0.0), (0.4, 0.9)])
def test_agents_of_gauntlet_receive_minus_the_initial_potential_and_the_success(
    velocity: tuple[float, float],
) -> None:
    scenario = csw.load_scenario("gauntlet")
    env = SwarmParallelEnv(scenario, shaping=True)
    plain = SwarmParallelEnv(scenario)
    alive = np.ones((1, scenario.n), bool)
    initial = potentials(scenario, [0], [scenario.positions], alive)[0]
    lost = 0
    for seed in range(5):
        env.reset(seed=seed)
        plain.reset(seed=seed)
        sums = dict.fromkeys(env.possible_agents, 0.0)
        while env.agents:
            before = len(env.agents)
            actions = {agent: scenario.swarm.v_max * np.array(velocity) for agent in env.agents}
            rewards, expected = env.step(actions)[1], plain.step(actions)[1]
            for agent, reward in rewards.items():
                sums[agent] += reward - expected[agent]
            lost += 0 < len(env.agents) < before
        np.testing.assert_allclose(list(sums.values()), -initial, atol=1e-12)
    assert lost > 0
    assert initial > 0.1


def test_risk_table_is_below_the_value_function() -> None:
    value, table = ValueFunction.from_scenario(SMALL), risk_table(SMALL)
    rng = np.random.default_rng(0)
    for step in (0, 3, 8):
        points = rng.uniform([-1.0, -1.0], [3.5, 1.5], (200, 2))
        high = value.bounds(step, points)[1]
        low = np.array([risk_to_go(table, step, *point) for point in points])
        assert (low <= high).all()
        near = np.isfinite(high) & (high > 0.05)
        assert (low[near] > 0.6 * high[near]).mean() > 0.9  # not only zeros


def test_potential_rises_with_the_living_and_is_one_in_the_target() -> None:
    positions = np.tile(SMALL.positions, (4, 1, 1))
    alive = np.array([[True] * 3, [True, True, False], [True, False, False], [False] * 3])
    found = potentials(SMALL, [0] * 4, positions, alive)
    assert (np.diff(found) < 0).all()
    assert found[-1] == 0.0
    positions[0, 0] = SMALL.target.center
    assert potentials(SMALL, [5] * 4, positions, alive)[0] == 1.0


def test_shaping_without_bounds_of_rates_raises() -> None:
    scenario = SMALL.with_hazard(patrolled, radars=[(1.5, 0.8)])
    with pytest.raises(csw.EnvError, match=r"CustomHazard does not provide.*shaping=False"):
        SwarmVectorEnv(scenario, 2, shaping=True)
