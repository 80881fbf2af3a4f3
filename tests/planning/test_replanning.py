"""Planning again for survivors: never worse, the same whatever the order, each situation once."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from small_scenarios import small

from casswarm import Scenario, SwarmPlan, evaluate, make_policy, plan, plan_swarm, simulate
from casswarm.errors import PolicyError
from casswarm.optimization.solvers import Ipopt
from casswarm.planning.joint import PlanTree
from casswarm.policies import JointPolicy, ReplanningPolicy

RADARS = [(1.0, 0.9), (2.2, -0.8)]


def crowded() -> Scenario:
    """Three members that collide: survivors close up."""
    positions = [(0.0, 0.0), (0.5, 0.1), (-0.2, 0.5)]
    return small(
        positions,
        (3.0, 0.2),
        RADARS,
        8,
        hazard__kind="saturation+collision",
        hazard__beta_1=0.3,
        hazard__beta_2=4.0,
    )


@pytest.fixture(scope="module")
def planned() -> tuple[Scenario, SwarmPlan]:
    scenario = crowded()
    return scenario, plan_swarm(scenario, initial_guesses=["formations"])


def feedback(
    planned: tuple[Scenario, SwarmPlan], mass: float = 1e-3, solver: Ipopt | None = None
) -> ReplanningPolicy:
    scenario, first = planned
    tree = PlanTree.from_plan(scenario, first, solver, mass)
    return ReplanningPolicy(tree, JointPolicy.from_plan(first))


def test_feedback_is_worth_more_than_the_plan(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, first = planned
    policy = feedback(planned)
    law = evaluate(scenario, policy, tolerance=0)
    assert first.success is not None
    assert first.bound is not None
    assert law.residual_mass == 0
    assert first.success[1] + 1e-4 < law.success[0] < first.bound.value
    assert policy.tree.solves > 10
    assert law.infeasible == 0


def test_every_situation_is_solved_once(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, _ = planned
    policy = feedback(planned)
    laws = [evaluate(scenario, policy, tolerance=0).success]
    solves = policy.tree.solves
    assert solves == len(policy.tree.branches)
    laws.append(evaluate(scenario, policy, tolerance=0).success)
    assert policy.tree.solves == solves
    assert laws[0] == laws[1]


def test_where_nothing_weighs_enough_it_is_the_joint_plan(
    planned: tuple[Scenario, SwarmPlan],
) -> None:
    scenario, first = planned
    policy = feedback(planned, mass=1.0)
    law = evaluate(scenario, policy, tolerance=0)
    assert policy.tree.solves == 0
    assert first.success is not None
    assert first.success[0] <= law.success[0] <= first.success[1]


def test_order_of_states_and_of_calls_changes_nothing(planned: tuple[Scenario, SwarmPlan]) -> None:
    """The same situations, all at once, one by one backwards, and after a pickle."""
    _, first = planned
    step = 3
    alive = np.array([[True, True, False], [True, False, True], [False, True, True], [True] * 3])
    positions = np.where(alive[..., None], first.positions[step], 0.0)
    previous_velocities = np.where(alive[..., None], first.velocities[step - 1], 0.0)
    policy = feedback(planned)
    sent = pickle.loads(pickle.dumps(policy))
    together = policy.velocities(step, positions, previous_velocities, alive)
    for again in (sent, feedback(planned)):
        for row in reversed(range(4)):
            one = again.velocities(
                step,
                positions[row : row + 1],
                previous_velocities[row : row + 1],
                alive[row : row + 1],
            )
            np.testing.assert_array_equal(one[0], together[row])


def test_runs_do_not_depend_on_batches(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, _ = planned
    studies = [
        simulate(
            scenario, [feedback(planned)], runs=60, seed=5, workers=workers, save_trajectories=0
        )
        for workers in (1, 2)
    ]
    assert studies[0].runs.equals(studies[1].runs)
    assert studies[0].summary["saturated"].item() == 0


def test_failed_solves_are_counted_and_do_no_harm(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, first = planned
    hopeless = Ipopt(max_iter=1, hessian="limited-memory")
    policy = feedback(planned, 1e-2, hopeless)
    law = evaluate(scenario, policy, tolerance=0)
    assert policy.tree.failures == policy.tree.solves > 0
    assert law.failures > 0
    assert first.success is not None
    assert law.success[0] >= first.success[0]


def test_distance_is_kept_by_survivors() -> None:
    scenario = small([(0.0, 0.0), (0.5, 0.1), (-0.2, 0.5)], (3.0, 0.2), RADARS, 8)
    first = plan_swarm(scenario, initial_guesses=["formations"], min_distance=0.3)
    tree = PlanTree.from_plan(scenario, first, min_probability=1e-2)
    evaluate(scenario, ReplanningPolicy(tree, JointPolicy.from_plan(first)), tolerance=1e-2)
    made = {id(b): b for b in tree.branches.values() if len(b.members) == 2}
    assert made
    for branch in made.values():
        apart = branch.positions[1:, 0] - branch.positions[1:, 1]
        assert np.hypot(*apart.T).min() >= 0.3 - 1e-4


def test_states_that_no_plan_leads_to_are_steered_back(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, first = planned
    policy = feedback(planned)
    places = scenario.positions[None] + 0.3
    found = policy.decide(0, places, first.initial_velocities[None], np.ones((1, 3), bool))
    blind = policy.open_loop.decide(
        0, places, first.initial_velocities[None], np.ones((1, 3), bool)
    )
    np.testing.assert_array_equal(found.velocities, blind.velocities)
    assert found.fallbacks.sum() == policy.tree.solves == 0


def test_policy_by_name_plans_again() -> None:
    scenario = small([(0.0, 0.0), (0.4, 0.1)], (3.0, 0.2), RADARS, 8)
    guide = plan(scenario, certify=False)
    policy = make_policy("joint-replanning", scenario, guide)
    law = evaluate(scenario, policy, tolerance=1e-3, guide=guide)
    blind = evaluate(scenario, "joint", tolerance=1e-3, guide=guide)
    assert law.success[1] >= blind.success[0]


def test_swarms_without_an_exact_law_are_refused() -> None:
    positions = [(0.1 * i, 0.0) for i in range(11)]
    scenario = small(positions, (3.0, 0.2), RADARS, 8)
    first = plan_swarm(scenario, initial_guesses=["formations"], time_limit=1e-3)
    with pytest.raises(PolicyError, match="at most 10 members; this swarm has 11"):
        PlanTree.from_plan(scenario, first)


def test_mass_out_of_range_is_refused(planned: tuple[Scenario, SwarmPlan]) -> None:
    with pytest.raises(PolicyError, match="from 0 to 1"):
        PlanTree.from_plan(*planned, min_probability=2.0)
