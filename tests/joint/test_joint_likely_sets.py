"""Bounds on the success of a plan, from its most probable sets of living members."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import BESIDE, around, small

import casswarm as csw
from casswarm import Scenario, plan_swarm
from casswarm.joint import PlanDistribution
from casswarm.joint.plan_distribution import likely_sets

STEPS = 6


def crossing(seed: int, n: int, **values: object) -> tuple[Scenario, np.ndarray]:
    """A scenario of n members, and trajectories to the target."""
    rng = np.random.default_rng(seed)
    scenario = small(around(rng, n), (3.0, 0.2), BESIDE, STEPS, **values)
    share = np.linspace(0.0, 1.0, STEPS + 1)[:, None, None]
    ends = np.array(scenario.target.center) + rng.uniform(-0.2, 0.2, (n, 2))
    return scenario, (1 - share) * scenario.positions + share * ends


@given(n=st.integers(1, 5), max_sets=st.integers(1, 32), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_bounds_contain_exact_success(n: int, max_sets: int, seed: int) -> None:
    scenario, positions = crossing(seed, n, hazard__alpha_1=3.0)
    exact = 1.0 - PlanDistribution.from_positions(scenario, positions).failure
    bounds = likely_sets(scenario, positions, max_sets)
    assert bounds.success.low <= exact <= bounds.success.high
    if max_sets >= 2**n:
        assert bounds.success.high - bounds.success.low < 1e-8


def test_sets_not_followed_succeed_as_often_as_their_core() -> None:
    scenario, positions = crossing(3, 5, hazard__alpha_1=6.0)
    exact = 1.0 - PlanDistribution.from_positions(scenario, positions).failure
    bounds = likely_sets(scenario, positions, 1)
    assert bounds.left > 0.1
    assert 0.1 < bounds.rescued < bounds.left
    assert bounds.success.low == pytest.approx(exact, abs=1e-7)  # all members are in the core


def test_with_collisions_nothing_is_known_of_sets_not_followed() -> None:
    scenario = csw.load_scenario("paper-2")
    share = np.linspace(0.0, 1.0, scenario.n_steps + 1)[:, None, None]
    center = np.array(scenario.target.center)
    positions = (1 - share) * scenario.positions + share * center
    exact = 1.0 - PlanDistribution.from_positions(scenario, positions).failure
    few, all_sets = likely_sets(scenario, positions, 2), likely_sets(scenario, positions)
    assert few.rescued == 0.0 < few.left
    assert few.success.low <= exact <= few.success.high
    assert all_sets.success.low <= exact <= all_sets.success.high
    assert all_sets.success.high - all_sets.success.low < 1e-6


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_bounds_do_not_depend_on_the_order_of_members(seed: int) -> None:
    scenario, positions = crossing(seed, 4, hazard__alpha_1=3.0)
    order = np.random.default_rng(seed).permutation(4)
    other = scenario.with_values({"swarm.positions": scenario.positions[order]})
    one, two = likely_sets(scenario, positions, 5), likely_sets(other, positions[:, order], 5)
    np.testing.assert_allclose(one.success, two.success, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_plan_of_twelve_members_states_proven_success() -> None:
    rng = np.random.default_rng(4)
    scenario = small(around(rng, 12), (3.0, 0.2), BESIDE, 8, hazard__alpha_1=20.0)
    plan = plan_swarm(scenario, initial_guesses=["formations"], certify=False)
    assert plan.likely is not None
    assert plan.success == plan.likely.success
    exact = 1.0 - PlanDistribution.from_positions(scenario, plan.positions).failure
    assert plan.success.low <= exact <= plan.success.high < plan.success.low + 1e-4
    assert f"success {plan.success.low:.6f} to" in str(plan)
