"""The environments of one swarm: Gymnasium's and PettingZoo's checks, agents that are destroyed."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from small_scenarios import small, three_members

import casswarm as csw
from casswarm.envs import SwarmEnv, SwarmParallelEnv, SwarmVectorEnv

SMALL = three_members(swarm__velocity=[1.0, 0.2])
DEADLY = SMALL.with_values({"hazard.alpha_1": 40.0})


@pytest.mark.parametrize("shaping", [False, True])
def test_single_env_passes_gymnasiums_check(shaping: bool) -> None:
    env = gymnasium.make("casswarm/Swarm-v0", scenario=SMALL, shaping=shaping)
    check_env(env.unwrapped)


def test_single_env_is_the_vector_env_of_one() -> None:
    one, many = SwarmEnv(SMALL), SwarmVectorEnv(SMALL, 1, autoreset_mode="Disabled")
    np.testing.assert_array_equal(one.reset(seed=4)[0], many.reset(seed=4)[0][0])
    terminated, action = False, np.tile([1.0, 0.2], (3, 1))
    while not terminated:
        observation, reward, terminated, truncated, info = one.step(action)
        expected = many.step(action[None])
        np.testing.assert_array_equal(observation, expected[0][0])
        assert (reward, terminated, truncated) == (expected[1][0], expected[2][0], False)
        assert info["survivors"] == expected[4]["survivors"][0]
    with pytest.raises(csw.EnvError, match="after the end"):
        one.step(action)
    one.reset()
    with pytest.raises(csw.EnvError, match=r"shape \(1, 2, 2\)"):
        one.step(action[:2])


def test_single_env_renders_pictures_and_none_without_a_mode() -> None:
    env = SwarmEnv(SMALL, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(np.tile([1.0, 0.2], (3, 1)))
    second = env.render()
    assert first is not None
    assert second is not None
    assert first.shape == second.shape
    assert first.dtype == np.uint8
    assert (first != second).any()
    assert SwarmEnv(SMALL).render() is None


@pytest.mark.parametrize("scenario", [SMALL, DEADLY], ids=["small", "deadly"])
def test_parallel_env_passes_pettingzoos_tests(
    scenario: csw.Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    parallel_api_test(SwarmParallelEnv(scenario), num_cycles=60)
    parallel_seed_test(lambda: SwarmParallelEnv(scenario), num_cycles=20)
    assert "Passed Parallel API test" in capsys.readouterr().out


def agents_actions(env: SwarmParallelEnv) -> dict[str, Any]:
    return {agent: np.array([1.0, 0.2]) for agent in env.agents}


@pytest.mark.parametrize("delay", [0, 1])
def test_parallel_env_has_the_runs_of_the_vector_env(delay: int) -> None:
    scenario = DEADLY.replace(information={"delay": delay})
    env, many = SwarmParallelEnv(scenario), SwarmVectorEnv(scenario, 1, autoreset_mode="Disabled")
    shrunk = 0
    for run in range(20):
        seed = 9 if run == 0 else None
        observations, infos = env.reset(seed=seed)
        many.reset(seed=seed)
        assert env.agents == env.possible_agents == ["member_0", "member_1", "member_2"]
        assert {info["run"] for info in infos.values()} == {run}
        while env.agents:
            before = list(env.agents)
            observations, rewards, ended, truncated, infos = env.step(agents_actions(env))
            expected = many.step(np.tile([1.0, 0.2], (1, 3, 1)))
            alive, believed = expected[4]["alive"][0], expected[0][0, :, 0] > 0
            assert list(observations) == list(rewards) == list(ended) == list(infos) == before
            assert set(rewards.values()) == {expected[1][0]}
            assert not any(truncated.values())
            for agent, observation in observations.items():
                member = env.possible_agents.index(agent)
                np.testing.assert_array_equal(observation, expected[0][0, member])
                assert env.observation_space(agent).contains(observation)
                assert ended[agent] == (expected[2][0] or not believed[member])
                assert infos[agent]["alive"] == alive[member]
            np.testing.assert_array_equal(env.state(), expected[0][0])
            shrunk += 0 < len(env.agents) < len(before)
        assert expected[2][0]
    assert shrunk > (2 if delay else 5)  # losses before the end that become known


def test_parallel_env_with_wrong_actions_raises() -> None:
    env = SwarmParallelEnv(SMALL)
    with pytest.raises(csw.EnvError, match="before the first reset"):
        env.step({})
    env.reset(seed=0)
    actions = agents_actions(env)
    with pytest.raises(csw.EnvError, match="expected one of every living agent"):
        env.step({"member_0": actions["member_0"]})
    with pytest.raises(csw.EnvError, match=r"member_1 has shape \(3,\); expected \(2,\)"):
        env.step(actions | {"member_1": np.zeros(3)})
    with pytest.raises(csw.EnvError, match=r"member 2 .* must be finite"):
        env.step(actions | {"member_2": np.array([0.0, np.nan])})
    with pytest.raises(csw.EnvError, match="render_mode = 'human'"):
        SwarmParallelEnv(SMALL, render_mode="human")


def test_swarm_of_one_without_radars_nearby_arrives() -> None:
    scenario = small([(0.0, 0.0)], (2.0, 0.0), [(90.0, 90.0)], 6, swarm__velocity=[1.0, 0.0])
    env = SwarmEnv(scenario)
    assert env.observation_space.shape == (1, 8)
    env.reset(seed=0)
    rewards = [env.step([[1.0, 0.0]])[1] for _ in range(5)]
    assert rewards == [0.0, 0.0, 0.0, 0.0, 1.0]
