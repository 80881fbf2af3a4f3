"""``success.arrivals``: several members must be in the target together."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from brute_force import commanded, law_by_hand, success_of
from env_cases import outcomes
from small_scenarios import small

import casswarm as csw
from casswarm.bounds.success_bound import _fewer_than
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import ScenarioError

STARTS = [(0.0, 0.0), (0.2, 0.4), (-0.6, -0.3)]
ONE = small(STARTS, (1.6, 0.0), [(0.9, 0.5)], 4, swarm__a_max=8.0, swarm__velocity=[0.5, 0.0])


def needing(k: int) -> csw.Scenario:
    return ONE.replace(success={"arrivals": k})


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_success_is_that_of_a_recursion_of_the_equations(name: str, k: int) -> None:
    one = needing(k)
    policy = csw.make_policy(name, one)
    start = np.tile(one.swarm.velocity, (one.n, 1))
    expected = success_of(law_by_hand(one, start, commanded(one, policy)))
    assert 0.01 < expected < 0.99
    exact = csw.evaluate(one, policy, 1e-9, aggregation_tol=0.0).success
    assert exact.low == pytest.approx(expected, abs=1e-8)
    runs = csw.simulate(one, [policy], 4000, seed=1)
    error = np.sqrt(expected * (1 - expected) / 4000)
    assert abs(runs.summary.success[0] - expected) < 4.5 * error
    assert csw.success_bound(one, max_work=1e6).value >= expected


def test_environment_has_the_runs_of_simulate() -> None:
    one = needing(2)
    guide = csw.plan(one, certify=False)
    table = outcomes(
        SwarmVectorEnv(one, 40, guide=guide), csw.make_policy("leader", one, guide), 7, episodes=3
    )
    runs = csw.simulate(one, ["leader"], runs=120, seed=7, guide=guide).runs
    assert 0 < runs["success"].sum() < 120
    np.testing.assert_array_equal(table["success"], runs["success"])
    np.testing.assert_array_equal(table["survivors"], runs["survivors"])


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_joint_plan_has_its_exact_law(k: int, objective: str) -> None:
    one = needing(k)
    plan = csw.plan_swarm(one, objective)
    exact = csw.evaluate(one, csw.make_policy("leader", one), 1e-9).success
    assert plan.success.low <= plan.bound.value
    if objective == "success":
        assert plan.success.low > exact.high
        law = csw.evaluate(one, "joint", 1e-9).success
        assert plan.value == pytest.approx(law.low, abs=1e-8)
        again = csw.evaluate(one, "joint-replanning", 1e-9).success
        assert again.low >= law.low - 1e-9


@pytest.mark.slow
def test_replanning_ends_with_the_plan_and_with_too_few_members() -> None:
    """A run may go on after the end of the plan, where those that are left do not suffice."""
    one = needing(3).replace(time={"t_f": ONE.time.t_f + 3 * ONE.time.dt})
    plan = csw.plan_swarm(one)
    assert len(plan.positions) - 1 <= one.n_steps
    law = csw.evaluate(one, "joint-replanning", 0.0).success
    assert law.low >= plan.success.low - 1e-12


@pytest.mark.slow
def test_more_arrivals_are_less_likely_for_every_policy_and_bound() -> None:
    guide = csw.plan(ONE)
    for name in ("naive", "leader-mpc-2", "constrained-feedback"):
        found = [csw.evaluate(needing(k), name, 1e-9, guide=guide).success.low for k in (1, 2, 3)]
        assert found == sorted(found, reverse=True)
    bounds = [csw.success_bound(needing(k)).value for k in (1, 2, 3)]
    assert bounds == sorted(bounds, reverse=True)


def test_fewer_than_is_a_sum_over_all_sets() -> None:
    risks = np.array([0.2, 1.5, np.inf, 0.7, 0.0])
    p = np.exp(-risks)
    for k in (1, 2, 3, 5):
        sets = [s for size in range(k) for s in combinations(range(5), size)]
        weights = [np.prod([p[i] if i in s else 1 - p[i] for i in range(5)]) for s in sets]
        assert _fewer_than(k, risks) == pytest.approx(sum(weights), rel=1e-12)


def test_more_arrivals_than_members_are_refused_by_the_key() -> None:
    with pytest.raises(ScenarioError, match=r"success\.arrivals is 4, but there are 3 members"):
        needing(4)
    for wrong in (0, 1.5, "two"):
        with pytest.raises(ScenarioError, match=r"success\.arrivals is"):
            ONE.replace(success={"arrivals": wrong})
