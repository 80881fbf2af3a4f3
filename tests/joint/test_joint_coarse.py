"""Coarse time steps of joint plans."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw
from casswarm.joint import SwarmOutcome
from casswarm.joint.search import coarse_task, coarsened, distinct, refined
from casswarm.problems import JointTask


def outcome(velocities: np.ndarray, arrivals: np.ndarray) -> SwarmOutcome:
    return SwarmOutcome("straight", arrivals, velocities, 0.5, None, 0.0)  # type: ignore[arg-type]


def test_coarse_scenario_has_the_same_time_of_flight_and_acceleration() -> None:
    scenario = csw.load_scenario("paper-1")
    coarse = coarsened(scenario)
    assert coarse is not None
    assert coarse.n_steps == 15
    assert coarse.time.dt * 15 == pytest.approx(scenario.time.dt * 30)
    assert coarse.swarm.a_max / coarse.time.dt**2 == pytest.approx(
        scenario.swarm.a_max / scenario.time.dt**2
    )
    assert coarsened(coarse) is None


@pytest.mark.parametrize(("steps", "levels"), [(29, []), (60, [15]), (120, [30, 15])])
def test_steps_are_reduced_by_at_most_four_at_a_time(steps: int, levels: list[int]) -> None:
    scenario, found = small([(0.0, 0.0)], (3.0, 0.0), [(1.0, 1.0)], steps), []
    while (coarse := coarsened(scenario)) is not None:
        scenario = coarse
        found.append(scenario.n_steps)
    assert found == levels


def test_refined_steady_plan_is_the_same_motion() -> None:
    scenario = csw.load_scenario("paper-1")
    coarse = coarsened(scenario)
    assert coarse is not None
    steady = np.tile([0.7, 0.4], (scenario.n, 1))
    task = JointTask.from_scenario(scenario, steady)
    assert coarse_task(task, coarse).steps == 15
    arrivals = np.array([14, 14, 13, 14, 14])
    guess = refined(outcome(np.tile(steady, (14, 1, 1)), arrivals), task, 15)
    np.testing.assert_allclose(guess.velocities, np.tile(steady, (28, 1, 1)))
    np.testing.assert_array_equal(guess.arrivals, 2 * arrivals)


def test_distinct_outcomes_exclude_copies_and_known_ones() -> None:
    scenario = csw.load_scenario("paper-1")
    task = JointTask.from_scenario(scenario, np.zeros((5, 2)))
    arrivals = np.full(5, 30)
    base = np.full((30, 5, 2), 0.7)
    near, far = base + 1e-4, base.copy()
    far[:, 0] += 0.1
    outcomes = [outcome(each, arrivals) for each in (base, near, far)]
    assert distinct(task, outcomes) == [outcomes[0], outcomes[2]]
    assert distinct(task, outcomes, [outcomes[1]]) == [outcomes[2]]
