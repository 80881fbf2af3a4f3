"""Brackets of the optimal value of two members, as an oracle of policies and bounds."""

from __future__ import annotations

import pytest
from small_scenarios import small

import casswarm as csw
from casswarm.policies import POLICIES
from casswarm.scenario.variations import with_parameters

RADARS = [(1.2, 0.4), (1.6, -0.9)]


def pair(**values):
    return small([(0.0, 0.0), (0.3, 0.2)], (2.2, 0.0), RADARS, 5, hazard__alpha_1=8.0, **values)


@pytest.mark.slow
def test_bracket_holds_every_policy():
    scenario = pair()
    guide = csw.plan(scenario, certify=False)
    optimum = csw.optimal_value(scenario, 5e-3, time_limit=6, guide=guide)
    assert optimum.unlimited.high - optimum.unlimited.low <= 5e-3
    assert optimum.success.low <= optimum.unlimited.low <= optimum.unlimited.high
    assert optimum.success.high <= optimum.unlimited.high
    for name in POLICIES:
        law = csw.evaluate(scenario, name, 1e-6, guide=guide).success
        assert law.low <= optimum.success.high
        assert law.low <= optimum.success.low + 1e-6  # none is better than optimal here
    assert optimum.success.high <= float(csw.success_bound(scenario))


def test_bracket_without_limit_of_acceleration_is_one_bracket():
    optimum = csw.optimal_value(pair(swarm__a_max=100.0), 5e-3, time_limit=6)
    assert optimum.success == optimum.unlimited
    assert len(optimum.bounds) == 1
    assert optimum.success.width <= 5e-3


@pytest.mark.slow
def test_optimal_value_with_collisions_is_lower():
    collisions = {"hazard__kind": "saturation+collision"}
    collisions |= {"hazard__beta_1": 0.2, "hazard__beta_2": 6.0}
    free, collided = (
        csw.optimal_value(pair(swarm__a_max=100.0, **values), 1e-2, time_limit=6).success
        for values in ({}, collisions)
    )
    assert collided.high < free.low


@pytest.mark.slow
@pytest.mark.parametrize("name", ["alley", "barricade", "gauntlet"])
def test_bracket_without_limit_is_narrow_on_built_in_scenarios(name):
    scenario = with_parameters(csw.load_scenario(name), {"n": 2, "swarm.a_max": 32.0})
    optimum = csw.optimal_value(scenario, 4e-3, time_limit=120)
    assert optimum.success.width <= 5e-3
    assert optimum.success.high <= float(csw.success_bound(scenario))


@pytest.mark.slow
def test_upper_end_is_not_above_the_bound_for_every_policy():
    scenario = with_parameters(csw.load_scenario("patrol"), {"n": 2})
    optimum = csw.optimal_value(scenario, 0.0, time_limit=0.3)  # ended by the time on a coarse grid
    bound = csw.success_bound(scenario).value
    assert optimum.bounds[-1].value > bound  # so that it matters
    assert optimum.success.high <= bound
    assert optimum.success.low <= optimum.success.high
