"""Parts of the package with radars that move and switch: equal to rest, known laws, sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from env_cases import outcomes
from parametric_cases import START, assert_equals_differences, gradient, steered

import casswarm as csw
from casswarm.bounds import pair_bound
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import PolicyError
from casswarm.exploration.answers import HazardMap
from casswarm.joint.plan_distribution import PlanDistribution
from casswarm.policies import Observation

REST = csw.Scenario.from_data(
    {
        "name": "rest",
        "swarm": {"positions": [[0, 0], [0, 0.3]], "v_max": 2.0, "a_max": 4.0, "velocity": [1, 0]},
        "target": {"center": [3.0, 0.0], "radius": 0.3},
        "time": {"dt": 0.5, "t_f": 2.5},
        "hazard": {
            "kind": "saturation+collision",
            "radars": [[1.5, 0.8], [1.0, -0.9]],
            "strengths": [1.0, 0.5],
            "alpha_1": 0.4,
            "alpha_2": 3.0,
            "alpha_3": 4.0,
            "beta_1": 0.05,
            "beta_2": 4.0,
        },
    }
)
SAME = [
    {"position": [1.5, 0.8], "velocity": [0.0, 0.0]},
    {"position": [1.0, -0.9], "strength": 0.5, "active": [[-1.0, 1.5], [1.5, 9.0]]},
]
MOVES = [
    {"position": [1.5, 0.8], "velocity": [0.2, -0.3]},
    {"path": [[0.0, 1.0, -0.9], [2.0, 1.4, -0.2]], "active": [[0.0, 1.0], [1.5, 2.5]]},
]


def with_radars(*radars: dict[str, Any]) -> csw.Scenario:
    return REST.with_values(
        {"hazard.radars": None, "hazard.strengths": None, "hazard.radar": list(radars)}
    )


MOVING = with_radars(*MOVES)


def of_policy(name: str) -> Callable[[csw.Scenario], Any]:
    return lambda one: csw.evaluate(one, csw.make_policy(name, one), 1e-9).success


PARTS: dict[str, Callable[[csw.Scenario], Any]] = {
    "leader-mpc-3": of_policy("leader-mpc-3"),
    "constrained-mpc-2": of_policy("constrained-mpc-2"),
    "joint": lambda one: csw.plan_swarm(one).value,
    "joint, many members": lambda one: (
        csw.plan_swarm(
            one.with_values({"swarm.positions": [[0.0, 0.02 * k] for k in range(12)]}),
            initial_guesses=["formations"],
        ).value
    ),
    "joint-replanning": of_policy("joint-replanning"),
    "bound of pairs": lambda one: pair_bound(one, max_nodes=200_000).value,
    "gradient": lambda one: gradient(one, steered(one)).gradient,
    "environment": lambda one: SwarmVectorEnv(one, 3, shaping=True).reset(seed=1)[0][..., :6],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "part",
    [pytest.param(part, marks=[pytest.mark.slow] * ("many members" in part)) for part in PARTS],
)
def test_radars_in_time_that_rest_are_as_radars_at_rest(part: str) -> None:
    same = with_radars(*SAME)
    assert same.hazard.changes
    assert not REST.hazard.changes
    np.testing.assert_allclose(PARTS[part](same), PARTS[part](REST), rtol=1e-7, atol=1e-9)


def test_maps_of_radars_that_rest_are_as_at_rest() -> None:
    same = with_radars(*SAME)
    guide = csw.plan(REST)
    (at_rest,) = HazardMap.around(REST, guide).shades
    in_time = HazardMap.around(same, guide).shades
    assert len(in_time) == REST.n_steps + 1
    for each in in_time.astype(int):  # quantiles of more pixels are interpolated otherwise
        assert abs(each - at_rest).max() <= 1
    moving = HazardMap.around(MOVING, guide).shades.astype(int)
    assert abs(moving[0] - moving[-1]).max() > 50


@pytest.mark.slow
def test_joint_plan_has_its_law_and_is_below_the_bound() -> None:
    plan = csw.plan_swarm(MOVING)
    exact = csw.evaluate(MOVING, csw.make_policy("joint", MOVING)).success
    assert plan.value == pytest.approx(exact.low, abs=1e-9)
    assert plan.bound.value >= plan.value
    at_rest = csw.plan_swarm(REST)
    law = PlanDistribution.from_positions(MOVING, at_rest.positions)
    assert law.success.high <= plan.value + 1e-6  # of the plan for radars that do not move


def test_plan_from_a_later_step_has_the_rates_of_then() -> None:
    path = np.linspace([0.0, 0.0], [2.0, 0.2], 4)[:, None] + np.array([[0.0, 0.1], [0.0, -0.1]])
    law = PlanDistribution.from_positions(MOVING, path, step=2)
    for t in range(3):
        rates = MOVING.hazard.rates(path[t + 1], time=0.5 * (t + 3))
        np.testing.assert_allclose(law.lost[t, -1], -np.expm1(-0.5 * rates), rtol=1e-12)


def test_gradient_is_that_of_finite_differences() -> None:
    assert_equals_differences(MOVING, steered(MOVING), START, arrival_smoothing=0.1)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_environment_has_the_runs_of_simulate(mode: str) -> None:
    guide = csw.plan(MOVING)
    env = SwarmVectorEnv(MOVING, 40, guide=guide, autoreset_mode=mode)
    table = outcomes(env, csw.make_policy("leader", MOVING, guide), seed=7, episodes=3)
    runs = csw.simulate(MOVING, ["leader"], runs=120, seed=7, guide=guide).runs
    assert 0 < runs["success"].sum() < 120
    np.testing.assert_array_equal(table["success"], runs["success"])
    np.testing.assert_array_equal(table["survivors"], runs["survivors"])


def test_observation_has_radars_of_its_step_and_of_coming_ones() -> None:
    observed = Observation.from_scenario(MOVING, "float64", preview=1)
    x = np.array([[[0.5, 0.1], [0.7, 0.2]]] * 2)
    numbers = observed(np.array([2, 3]), x, 0 * x, np.ones((2, 2), bool))
    assert numbers.shape == (2, 2, observed.size)
    tracks = [radar.track for radar in MOVING.hazard_table.radar]
    for state, step in enumerate((2, 3)):
        parts = numbers[state, 1, observed.slices["radars"]].reshape(2, 2, 3)
        for ahead, track_index in np.ndindex(2, 2):
            track, time = tracks[track_index], 0.5 * (step + ahead)
            offset = (np.array(track.position_at(time)) - x[state, 1]) / observed.length
            np.testing.assert_allclose(parts[ahead, track_index, :2], offset, atol=1e-12)
            assert parts[ahead, track_index, 2] == track.strength_at(time)
    low, high = observed.bounds()
    assert (low <= numbers).all()
    assert (numbers <= high).all()
    np.testing.assert_allclose(observed.state(numbers).positions, x, rtol=1e-12)
    with pytest.raises(PolicyError, match="preview = 6; allowed: whole numbers of steps"):
        Observation.from_scenario(MOVING, preview=6)


def test_model_with_a_preview_is_a_policy() -> None:
    size = Observation.from_scenario(MOVING, preview=2).size
    env = SwarmVectorEnv(MOVING, 1, radar_preview=2)
    assert env.single_observation_space.shape == (2, size)
    policy = csw.as_policy(lambda o: 0.5 * o[..., 6:8], MOVING, name="m", radar_preview=2)
    assert 0.0 <= csw.evaluate(MOVING, policy).success.high <= 1.0
