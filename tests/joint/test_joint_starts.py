"""Starts of joint plans: their screening, changes of a plan, and plans against random restarts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from small_scenarios import abreast, small

from casswarm import Scenario, plan_swarm
from casswarm.joint import InitialGuess, PlanDistribution
from casswarm.joint.initial_guesses import Family, changes, screened, tracked_positions
from casswarm.joint.plan_distribution import prescribed_costs
from casswarm.problems import JointTask

TRIO = abreast(3, swarm__velocity=(1.0, 0.0))
TASK = JointTask.from_scenario(TRIO, np.tile([1.0, 0.0], (3, 1)))


@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_prescribed_costs_match_distribution_with_same_arrivals(objective: str) -> None:
    speeds = np.random.default_rng(2).uniform(0.8, 1.0, (2, 8, 3, 2)) * [1.2, 0.05]
    positions = np.stack([tracked_positions(TASK, each) for each in speeds])
    inside = TRIO.target.contains(positions[:, 1:])
    arrivals = np.where(inside.any(axis=1), inside.argmax(axis=1) + 1, 0)
    first = [PlanDistribution.from_positions(TRIO, each) for each in positions]
    costs = prescribed_costs(TRIO, objective, positions, arrivals)
    expected = [each.cost(objective) for each in first]
    np.testing.assert_allclose(costs, expected, atol=1e-12)


def test_screened_prefers_low_cost_and_other_families() -> None:
    """The second best of a family counts as somewhat worse than the best of another."""
    line = np.linspace(TRIO.positions, np.array(TRIO.target.center), 9)[1:]
    aside = line + np.linspace(0, 1, 8)[:, None, None] * np.array([0.0, 0.01])
    far = line + np.array([0.0, 0.8])
    arrivals = np.full((2, 3), 8)
    families = [
        Family("near", arrivals, np.stack([line, aside], axis=1)),
        Family("far", arrivals[:1], far[:, None]),
    ]
    guesses = screened(TRIO, TASK, "success", families, 2)
    assert [guess.velocities.shape for guess in guesses] == [(8, 3, 2)] * 2
    assert guesses[0].name == "near"
    assert len(screened(TRIO, TASK, "success", families, 9)) == 3


def test_changes_of_plan_are_exchanges_turns_times_and_paths() -> None:
    plan = InitialGuess("formation LR", np.array([6, 7, 8]), np.full((8, 3, 2), [1.1, 0.0]))
    path = np.linspace([0.0, 0.0], [3.0, 0.2], 8)
    paths = {"LR": [path], "RR": [path]}
    exchanged, turned, *stretched, rerouted = changes(TASK, plan, paths)
    assert len(exchanged.arrivals) == math.factorial(3) - 1
    assert sorted(exchanged.arrivals[0].tolist()) == [6, 7, 8]
    assert len(turned.arrivals) == 23
    assert len(rerouted.arrivals) == 3 * 2
    assert [family.arrivals.max() for family in stretched] == [6, 7]
    for family in (exchanged, turned, *stretched, rerouted):
        assert family.goals.shape == (8, len(family.arrivals), 3, 2)
        assert family.name == "formation LR, changed"


def colliding() -> Scenario:
    positions = [(0.459, 0.485), (0.163, -0.336), (-0.105, -0.222)]
    radars = [(-2.129, 1.511), (-3.729, 0.156), (-0.589, 1.226), (-0.386, 1.417)]
    scenario = small(positions, (-3.706, 1.723), radars, 14, swarm__velocity=(-1.0, 0.465))
    values = {"kind": "saturation+collision", "alpha_1": 2.15, "beta_1": 0.2, "beta_2": 6.0}
    changed = {f"hazard.{key}": value for key, value in values.items()}
    return scenario.with_values(changed | {"swarm.a_max": 1.0})


@pytest.mark.slow
def test_plan_swarm_is_as_good_as_random_restarts() -> None:
    """The best of 40 random restarts had 0.29287, and beat plans from fixed formations by 6 %."""
    assert 1 - plan_swarm(colliding()).value <= 1.001 * 0.29287
