"""The vector environment: the runs of `simulate`, the interface of Gymnasium, its errors."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import pytest
from env_cases import outcomes
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics
from small_scenarios import patrolled, small, three_members

import casswarm as csw
from casswarm.envs import SwarmVectorEnv

SMALL = three_members(swarm__velocity=[1.0, 0.2])
CALM = SMALL.with_values({"hazard.radars": [[90.0, 90.0]]})


def ahead(env: SwarmVectorEnv, velocity: tuple[float, float] = (1.0, 0.2)) -> Any:
    return np.tile(velocity, (env.num_envs, env.scenario.n, 1))


def finished(env: SwarmVectorEnv) -> tuple[Any, ...]:
    """The step in which all runs of `CALM` end at the horizon."""
    env.reset(seed=0)
    for _ in range(env.scenario.n_steps - 1):
        assert not env.step(ahead(env, (-1.0, 0.2)))[2].any()
    result = env.step(ahead(env, (-1.0, 0.2)))
    assert result[2].all()
    return result


def same_runs(table: dict[str, Any], runs: pd.DataFrame) -> None:
    for column in ("success", "survivors", "steps", "saturated"):
        np.testing.assert_array_equal(table[column], runs[column].to_numpy(float), column)


@pytest.fixture(scope="module")
def guide() -> csw.Guide:
    return csw.plan(SMALL, certify=False)


@pytest.mark.parametrize("policy", ["naive", "leader"])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_env_with_policy_has_runs_of_simulate(policy: str, mode: str, guide: csw.Guide) -> None:
    env = SwarmVectorEnv(SMALL, 40, guide=guide, autoreset_mode=mode)
    table = outcomes(env, csw.make_policy(policy, SMALL, guide), seed=7, episodes=3)
    runs = csw.simulate(SMALL, [policy], runs=120, seed=7, guide=guide).runs
    assert 0 < runs["success"].sum() < 120
    same_runs(table, runs)
    np.testing.assert_array_equal(table["returns"], table["success"])


@pytest.mark.parametrize("delay", [1, 3, "never"])
def test_env_with_late_news_has_runs_of_simulate(delay: int | str, guide: csw.Guide) -> None:
    """The policy reads the living from the observations, in which ghosts seem to live."""
    scenario = SMALL.replace(information={"delay": delay})
    env = SwarmVectorEnv(scenario, 60, guide=guide)
    policy = csw.make_policy("leader", scenario, guide)
    table = outcomes(env, policy, seed=7, episodes=3)
    runs = csw.simulate(scenario, [policy], runs=180, seed=7, guide=guide).runs
    same_runs(table, runs)


def test_env_shows_ghosts_until_their_loss_is_known() -> None:
    deadly = SMALL.with_values({"hazard.alpha_1": 3.0, "information.delay": 2})
    env = SwarmVectorEnv(deadly, 50, autoreset_mode="Disabled")
    env.reset(seed=1)
    alive = []
    seen = 0
    for _ in range(4):
        observations, _, ended, _, infos = env.step(ahead(env))
        alive.append(infos["alive"])
        believed = observations[..., 0] > 0
        known = alive[-3] if len(alive) > 2 else np.ones_like(believed)
        running = ~ended
        np.testing.assert_array_equal(believed[running], known[running])
        seen += int((believed & ~infos["alive"])[running].sum())
    assert seen > 10


def test_env_with_members_that_differ_has_runs_of_simulate() -> None:
    kinds = {
        "swarm.kind": ["carrier", "companion", "slow"],
        "swarm.kinds.companion": {"exposure": 3.0, "density": 2.0, "counts": False, "v_max": 2.5},
        "swarm.kinds.slow": {"v_max": 1.2, "a_max": 0.2, "exposure": 0.5},
    }
    scenario = SMALL.with_values(kinds)

    def hurried(step: int, positions: Any, _: Any, alive: Any) -> Any:
        return alive[..., None] * (np.array([2.3, 0.1]) + np.sin(5.0 * positions + step))

    env = SwarmVectorEnv(scenario, 60)
    table = outcomes(env, csw.as_policy(hurried), seed=5, episodes=3)
    guide = csw.plan(scenario, certify=False)
    runs = csw.simulate(scenario, hurried, runs=180, seed=5, guide=guide).runs
    assert 0 < runs["success"].sum() < 180
    same_runs(table, runs)
    assert table["saturated"].sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper-1", "paper-2", "alley", "gauntlet"])
def test_env_of_builtin_scenario_has_runs_of_simulate(name: str) -> None:
    scenario = csw.load_scenario(name)
    env = SwarmVectorEnv(name, 500)  # both plan a guide of their own
    table = outcomes(env, csw.make_policy("leader", scenario), seed=1, episodes=2)
    runs = csw.simulate(scenario, "leader", runs=1000, seed=1).runs
    same_runs(table, runs)


def test_env_with_collisions_and_random_actions_has_runs_of_simulate() -> None:
    scenario = csw.load_scenario("paper-2").with_values({"swarm.velocity": [1.0, 0.5]})

    def erratic(step: int, positions: Any, _: Any, alive: Any) -> Any:
        wave = np.sin(7.0 * positions + step)
        return alive[..., None] * (np.array([1.4, 0.6]) + 3.0 * wave)

    env = SwarmVectorEnv(scenario, 60)
    table = outcomes(env, csw.as_policy(erratic), seed=2**64 - 1, episodes=2)
    guide = csw.plan(scenario, certify=False)
    runs = csw.simulate(scenario, erratic, runs=120, seed=2**64 - 1, guide=guide).runs
    same_runs(table, runs)
    assert table["saturated"].sum() > 0


def test_env_with_custom_rates_has_runs_of_simulate() -> None:
    scenario = SMALL.with_hazard(patrolled, radars=[(1.5, 0.8)])
    env = SwarmVectorEnv(scenario, 50)
    guide = csw.plan(scenario, solver="ipopt", search="local", certify=False)

    def straight(_: int, positions: Any, *__: Any) -> Any:
        return (np.array([3.0, 0.0]) - positions) / scenario.time.t_f

    table = outcomes(env, csw.as_policy(straight), seed=3, episodes=1)
    runs = csw.simulate(scenario, straight, runs=50, seed=3, guide=guide).runs
    np.testing.assert_array_equal(table["survivors"], runs["survivors"].to_numpy(float))


@pytest.mark.parametrize("size", [1, 3, 64, 65, 130])
def test_env_of_any_size_has_the_same_runs(size: int) -> None:
    env = SwarmVectorEnv(SMALL, size)
    table = outcomes(env, csw.as_policy(lambda *s: s[2] + 0.1), seed=1, episodes=-(-130 // size))
    one = SwarmVectorEnv(SMALL, 10)
    expected = outcomes(one, csw.as_policy(lambda *s: s[2] + 0.1), seed=1, episodes=13)
    for key, values in expected.items():
        np.testing.assert_array_equal(table[key][:130], values, key)


def test_reset_with_seed_repeats_and_without_continues() -> None:
    env = SwarmVectorEnv(SMALL, 4)
    _, infos = env.reset(seed=5)
    np.testing.assert_array_equal(infos["run"], [0, 1, 2, 3])
    np.testing.assert_array_equal(env.reset()[1]["run"], [4, 5, 6, 7])
    np.testing.assert_array_equal(env.reset(seed=5)[1]["run"], [0, 1, 2, 3])
    seeds = {int(env.batch.swarms.seeds[0])}
    for _ in range(2):
        other = SwarmVectorEnv(SMALL, 4)
        other.reset()
        seeds.add(int(other.batch.swarms.seeds[0]))
    assert len(seeds) == 3  # unseeded environments differ


def test_next_step_mode_ignores_the_action_of_the_reset() -> None:
    env = SwarmVectorEnv(CALM, 2)
    initial, _ = env.reset(seed=0)
    finished(env)
    actions = np.full((2, 3, 2), np.nan)
    observations, rewards, terminated, _, infos = env.step(actions)
    np.testing.assert_array_equal(observations, initial)
    assert not rewards.any()
    assert not terminated.any()
    np.testing.assert_array_equal(infos["run"], [2, 3])
    np.testing.assert_array_equal(infos["survivors"], [3, 3])


def test_same_step_mode_returns_the_last_observation_in_infos() -> None:
    same = SwarmVectorEnv(SMALL, 30, autoreset_mode="SameStep")
    plain = SwarmVectorEnv(SMALL, 30, autoreset_mode="Disabled")
    initial, _ = same.reset(seed=0)
    plain.reset(seed=0)
    ended: Any = np.zeros(30, bool)
    while not ended.any():
        observations, rewards, ended, _, infos = same.step(ahead(same))
        expected = plain.step(ahead(plain))
    assert not ended.all()
    np.testing.assert_array_equal(ended, expected[2])
    np.testing.assert_array_equal(rewards, expected[1])
    np.testing.assert_array_equal(observations[ended], initial[ended])
    np.testing.assert_array_equal(observations[~ended], expected[0][~ended])
    np.testing.assert_array_equal(np.stack(infos["final_obs"][ended]), expected[0][ended])
    assert set(infos["final_obs"][~ended]) == {None}
    for key in ("survivors", "success", "saturated", "run", "step"):
        np.testing.assert_array_equal(infos["final_info"][key][ended], expected[4][key][ended])
        np.testing.assert_array_equal(infos[key][~ended], expected[4][key][~ended])
    assert not infos["step"][ended].any()
    np.testing.assert_array_equal(infos["run"], np.arange(30) + 30 * ended)
    np.testing.assert_array_equal(infos["_final_obs"], ended)


def test_disabled_mode_resets_by_mask_only() -> None:
    env = SwarmVectorEnv(CALM, 4, autoreset_mode=AutoresetMode.DISABLED)
    finished(env)
    with pytest.raises(csw.EnvError, match=r"step after the end.*4 of 4 .*reset_mask"):
        env.step(ahead(env))
    before, mask = env.batch.observe(), np.array([True, False, True, False])
    observations, infos = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[~mask], before[~mask])
    np.testing.assert_array_equal(infos["_run"], mask)
    np.testing.assert_array_equal(infos["run"], [4, 1, 6, 3])
    frozen, rewards, terminated, _, infos = env.step(ahead(env))
    np.testing.assert_array_equal(frozen[~mask], before[~mask])
    np.testing.assert_array_equal(terminated, ~mask)
    np.testing.assert_array_equal(infos["_step"], mask)
    assert not rewards.any()


def test_disabled_mode_freezes_ended_runs_until_all_end() -> None:
    env = SwarmVectorEnv(SMALL, 30, shaping=True, autoreset_mode=AutoresetMode.DISABLED)
    observations, _ = env.reset(seed=0)
    ended: Any = np.zeros(30, bool)
    steps: Any = np.zeros(30, int)
    success: Any = np.zeros(30, bool)
    while not ended.all():
        actions = ahead(env)
        actions[ended] = np.nan
        before, frozen = observations, ended
        observations, rewards, ended, _, infos = env.step(actions)
        np.testing.assert_array_equal(observations[frozen], before[frozen])
        assert not rewards[frozen].any()
        assert ended[frozen].all()
        np.testing.assert_array_equal(infos["_success"], ~frozen)
        steps[~frozen] = infos["step"][~frozen]
        success |= infos["success"] & infos["_success"]
    assert len(set(steps)) > 1
    runs = csw.simulate(SMALL, lambda *s: 0 * s[1] + [1.0, 0.2], runs=30, seed=0).runs
    np.testing.assert_array_equal(steps, runs["steps"])
    np.testing.assert_array_equal(success, runs["success"])
    with pytest.raises(csw.EnvError, match="30 of 30 runs"):
        env.step(ahead(env))


def test_disabled_mode_with_runs_that_have_not_begun_raises() -> None:
    env = SwarmVectorEnv(CALM, 4, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0, options={"reset_mask": np.array([True, False, True, False])})
    with pytest.raises(csw.EnvError, match=r"2 of 4 runs \(environment 1, 3\)") as caught:
        env.step(ahead(env))
    np.testing.assert_array_equal(caught.value.environments, [1, 3])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_state_of_observations_is_the_state(dtype: str) -> None:
    env = SwarmVectorEnv(SMALL, 40, dtype=dtype, autoreset_mode="Disabled")
    env.reset(seed=3)
    observation, swarms, lost = env.batch.observation, env.batch.swarms, 0
    for _ in range(4):
        observations = env.step(ahead(env))[0]
        some = swarms.alive.any(axis=1)
        state = observation.state(observations[some])
        tol = 1e-12 if dtype == "float64" else 1e-5
        np.testing.assert_array_equal(state.steps, swarms.steps[some])
        np.testing.assert_array_equal(state.alive, swarms.alive[some])
        np.testing.assert_allclose(state.positions, swarms.positions[some], atol=tol)
        np.testing.assert_allclose(state.previous_velocities, swarms.velocities[some], atol=tol)
        lost += (~state.alive).sum()
    assert lost > 0


def test_state_of_wrong_observations_raises() -> None:
    env = SwarmVectorEnv(SMALL, 2)
    observations, _ = env.reset(seed=0)
    state = env.batch.observation.state
    with pytest.raises(csw.PolicyError, match=r"expected \(B, 3, \d+\).*observations\[None\]"):
        state(observations[0])
    with pytest.raises(csw.PolicyError, match=r"state 0 has no living .* not contain the step"):
        state(0 * observations)
    observations[1, 2, 4] = np.nan
    with pytest.raises(csw.PolicyError, match=r"not finite at index \(1, 2, 4\)"):
        state(observations)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_env_works_in_gymnasiums_wrappers(mode: str) -> None:
    options = {"num_envs": 5, "scenario": CALM, "autoreset_mode": mode}
    made = gymnasium.make_vec("casswarm/Swarm-v0", **options)
    assert isinstance(made, SwarmVectorEnv)
    listed, recorded = DictInfoToList(made), RecordEpisodeStatistics(made)
    recorded.reset(seed=0)
    lengths: list[int] = []
    for _ in range(15):
        infos = recorded.step(ahead(made, (-1.0, 0.2)))[4]
        if "episode" in infos:
            lengths += infos["episode"]["l"][infos["_episode"]].tolist()
    assert lengths == [CALM.n_steps] * 5
    infos = listed.step(ahead(made, (-1.0, 0.2)))[4]
    assert [info["survivors"] for info in infos] == [3] * 5


def test_spaces_hold_every_observation_and_sampled_action() -> None:
    for dtype in ("float32", "float64"):
        env = SwarmVectorEnv(SMALL, 20, dtype=dtype)
        env.action_space.seed(0)
        observations, _ = env.reset(seed=0)
        assert observations.dtype == env.observation_space.dtype == dtype
        for _ in range(30):
            assert env.observation_space.contains(observations)
            actions = env.action_space.sample()
            assert actions.shape == (20, 3, 2)
            observations = env.step(4.0 * actions)[0]  # beyond the limits, which are kept


def test_copied_and_pickled_env_continues_alike() -> None:
    env = SwarmVectorEnv(SMALL, 30, shaping=True)
    env.reset(seed=0)
    env.step(ahead(env))
    copies = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    for _ in range(10):
        expected = env.step(ahead(env))
        for other in copies:
            for found, value in zip(other.step(ahead(env))[:4], expected[:4], strict=True):
                np.testing.assert_array_equal(found, value)


def test_infeasible_action_moves_as_its_projection_and_is_counted() -> None:
    env = SwarmVectorEnv(SMALL, 1)
    env.reset(seed=0)
    actions = np.tile([1.0, 0.2], (1, 3, 1))
    actions[0, 1] = [1.0, 5.0]
    before = env.batch.swarms.positions.copy()
    infos = env.step(actions)[4]
    assert infos["saturated"][0] == 1
    assert infos["alive"].all()
    moved = (env.batch.swarms.positions - before)[0] / SMALL.time.dt
    np.testing.assert_allclose(moved[[0, 2]], [[1.0, 0.2]] * 2)
    np.testing.assert_allclose(moved[1], [1.0, 0.2 + np.sqrt(0.5)])


def test_run_ends_as_terminated_at_arrival_extinction_and_horizon() -> None:
    def last(radars: list[tuple[float, float]], **values: Any) -> tuple[Any, Any, Any]:
        scenario = small([(0.0, 0.0)], (3.0, 0.0), radars, 5, **values)
        env = SwarmVectorEnv(scenario.with_values({"swarm.velocity": [1.8, 0.0]}), 1)
        env.reset(seed=0)
        for step in range(1, 6):
            _, rewards, terminated, truncated, infos = env.step([[[1.8, 0.0]]])
            assert not truncated.any()
            if terminated[0]:
                return step, rewards[0], infos["survivors"][0]
        raise AssertionError

    assert last([(90.0, 90.0)]) == (5, 1.0, 1)  # 2.97 of 3.0, within the radius
    assert last([(90.0, 90.0)], target__radius=0.02) == (5, 0.0, 1)
    assert last([(0.6, 0.0)], hazard__alpha_1=1e6) == (1, 0.0, 0)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros((2, 2, 2)), r"shape \(2, 2, 2\); expected \(2, 3, 2\)"),
        ("fast", "object of type str"),
        (np.full((2, 3, 2), np.nan), r"member 0 in environment 0 is \[nan nan\]"),
        (np.full((2, 3, 2), np.inf), "must be finite"),
    ],
)
def test_step_with_bad_actions_raises_and_moves_nothing(action: Any, message: str) -> None:
    env = SwarmVectorEnv(SMALL, 2)
    observations, _ = env.reset(seed=0)
    with pytest.raises(csw.EnvError, match=message):
        env.step(action)
    np.testing.assert_array_equal(env.batch.observe(), observations)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"render_mode": "human"}, "render_mode = 'human'; allowed: None, 'rgb_array'"),
        ({"autoreset_mode": "never"}, "autoreset_mode = 'never'; allowed: 'NextStep'"),
        ({"num_envs": 0}, "num_envs = 0"),
        ({"discount": 1.5}, r"discount = 1.5"),
        ({"dtype": "int8"}, "dtype = 'int8'; allowed: float32 or float64"),
    ],
)
def test_env_with_invalid_argument_raises(arguments: dict[str, Any], message: str) -> None:
    error = csw.PolicyError if "dtype" in arguments else csw.EnvError
    with pytest.raises(error, match=message):
        SwarmVectorEnv(SMALL, **arguments)


def test_step_before_reset_and_bad_masks_raise() -> None:
    env = SwarmVectorEnv(SMALL, 2)
    with pytest.raises(csw.EnvError, match="before the first reset"):
        env.step(ahead(env))
    for mask in (np.zeros(2, bool), np.ones(3, bool), np.array([1, 0])):
        with pytest.raises(csw.EnvError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="seed = -1"):
        env.reset(seed=-1)


class Turning(csw.Saturation):
    """Rates that are negative near a radar."""

    def source(self, squared_distance: Any) -> Any:
        return squared_distance - 0.5


def test_step_to_rates_that_are_negative_raises() -> None:
    env = SwarmVectorEnv(SMALL.with_hazard(Turning, radars=[(1.5, 0.8)]), 2)
    env.reset(seed=0)
    for _ in range(2):
        env.step(ahead(env))
    with pytest.raises(csw.HazardError, match="finite and not negative"):
        env.step(ahead(env))
