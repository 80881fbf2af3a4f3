"""Predicted numbers of states and their memory, and evaluations within a limit of memory."""

from __future__ import annotations

import math

import pytest

import casswarm as csw
from casswarm.chain import ExpansionOptions, StateSpaceExpansion

PAPER = csw.load_scenario("paper-1")
GUIDE = csw.plan(PAPER, certify=False)


def test_single_agent_has_one_state_a_step():
    scenario = csw.load_scenario("single-agent")
    guide = csw.plan(scenario, certify=False)
    expected = csw.evaluate(scenario, "leader", guide=guide).states
    found = csw.predict_states(scenario, "leader", guide=guide)
    assert found.states == expected == len(guide.velocities)
    assert not found.limited


@pytest.mark.parametrize(
    ("name", "policy", "tolerance"),
    [
        ("paper-1", "leader", 1e-3),
        ("paper-1", "constrained", 1e-3),
        ("paper-1", "naive", 1e-3),
        ("paper-2", "naive", 1e-3),
        ("gauntlet", "naive", 1e-3),
        ("barricade", "constrained", 1e-3),
        ("companions", "leader", 1e-3),
        ("crossfire", "constrained", 1e-2),
        ("paper-1", "leader", 1e-5),
    ],
)
def test_prediction_is_within_factor_of_ten_and_mostly_too_large(name, policy, tolerance):
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario, certify=False)
    states = csw.evaluate(scenario, policy, tolerance, guide=guide).states
    predicted = csw.predict_states(scenario, policy, tolerance, guide=guide)
    assert 0.8 * states < predicted.states < 10 * states
    assert not predicted.limited


def test_prediction_knows_the_limits():
    few = csw.predict_states(PAPER, "leader", max_states=100, guide=GUIDE)
    assert few.limited
    assert few.states == 100
    assert "limits come before the tolerance" in str(few)
    many = csw.predict_states(PAPER, "leader", guide=GUIDE)
    assert str(many).startswith("about ")
    assert many.megabytes < 5.0


def test_prediction_is_the_same_again():
    first, second = (csw.predict_states(PAPER, "naive", guide=GUIDE) for _ in range(2))
    assert first == second


def test_bounds_with_little_memory_contain_those_with_enough():
    scenario = csw.load_scenario("gauntlet")
    guide = csw.plan(scenario, certify=False)
    options = {"guide": guide, "max_states": 40_000}
    enough = csw.evaluate(scenario, "leader", 1e-2, **options)
    few = csw.evaluate(scenario, "leader", 1e-2, memory=1, **options)
    assert few.success.low <= enough.success.low + 1e-12
    assert few.success.high >= enough.success.high - 1e-12
    assert few.success.width > 2 * enough.success.width
    assert "--memory" in few.advice


def test_states_that_wait_take_no_more_than_the_memory():
    scenario = csw.load_scenario("gauntlet")
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy("leader", scenario, guide)
    velocities = guide.velocities[0] + 0.0 * scenario.positions
    options = ExpansionOptions(1e-3, 20_000, max_bytes=1_000_000)
    expansion = StateSpaceExpansion(scenario, policy, velocities, options)
    expansion.expand()
    assert len(expansion.frontier) <= expansion.max_stored
    assert expansion.max_stored * expansion.bytes_per_state <= options.max_bytes


@pytest.mark.parametrize("memory", [0.5, 0, -1, math.nan, math.inf])
def test_impossible_memory_is_refused(memory):
    with pytest.raises(ValueError, match=r"memory = .*; allowed: megabytes from 1"):
        csw.evaluate(PAPER, "naive", memory=memory, guide=GUIDE)
