"""The policy of two members that follows their best known plan."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from commands import casswarm
from small_scenarios import small

import casswarm as csw
from casswarm.errors import PolicyError

STARTS = [(0.0, 0.0), (0.3, 0.2)]


@cache
def scenario():
    return small(STARTS, (2.2, 0.0), [(1.2, 0.4), (1.6, -0.9)], 6, hazard__alpha_1=8.0)


@cache
def guide():
    return csw.plan(scenario(), certify=False)


@cache
def policy():
    return csw.make_policy("optimal", scenario(), guide())


def states(batch, seed):
    """States off every plan, with zero entries of the destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, 2)) < 0.7
    living = alive[..., None]
    positions = guide().positions[2] + rng.normal(0, 0.2, (batch, 2, 2))
    previous_velocities = guide().velocities[1] + rng.normal(0, 0.2, (batch, 2, 2))
    return positions * living, np.clip(previous_velocities, -2, 2) * living, alive


def test_decisions_off_plan_respect_hard_constraints():
    positions, previous_velocities, alive = states(12, seed=0)
    velocities = policy().decide(2, positions, previous_velocities, alive).velocities
    assert np.abs(velocities[alive]).max() <= 2.0
    changes = np.hypot(*(velocities - previous_velocities)[alive].T)
    assert changes.max() <= np.sqrt(0.5) + 1e-9
    assert (velocities[~alive] == 0).all()


def test_decision_of_batch_equals_single_states():
    state = states(8, seed=1)
    together = policy().velocities(3, *state)
    for b in range(8):
        alone = policy().velocities(3, *(part[b] for part in state))
        np.testing.assert_array_equal(together[b], alone)


def test_pair_off_plan_succeeds_more_often_than_straight_lines():
    """From a disturbed start, members return to the plan."""
    moved = scenario().with_values({"swarm.positions": [[0.1, -0.3], [-0.2, 0.1]]})
    found = csw.evaluate(moved, policy(), 0.0, guide=guide()).success
    naive = csw.evaluate(moved, "naive", 0.0).success
    assert found.low > naive.high


@pytest.mark.slow
def test_optimal_is_at_least_as_good_as_every_other_policy():
    laws = {
        name: csw.evaluate(scenario(), name, 1e-6, guide=guide()).success
        for name in ("naive", "leader", "leader-feedback", "joint", "joint-replanning")
    }
    best = csw.evaluate(scenario(), policy(), 0.0, guide=guide()).success
    assert best.low >= max(law.low for law in laws.values()) - 1e-9
    assert best.width < 1e-9


def test_simulation_agrees_with_exact_law():
    law = csw.evaluate(scenario(), policy(), 0.0, guide=guide()).success
    study = csw.simulate(scenario(), [policy()], runs=4000, seed=1, guide=guide())
    row = study.summary.iloc[0]
    assert row["success_low"] <= law.high
    assert row["success_high"] >= law.low
    assert row["solver_failures"] == 0


def test_exchanged_members_have_the_same_law():
    fixed = scenario().with_values({"swarm.velocity": [1.0, 0.5]})
    exchanged = fixed.with_values({"swarm.positions": STARTS[::-1]})
    first, second = (csw.evaluate(s, "optimal", 0.0).success for s in (fixed, exchanged))
    assert abs(first.low - second.low) < 1e-5


def test_five_members_raise_policy_error():
    with pytest.raises(PolicyError, match=r"policy 'optimal': .* two members; 'paper-1' has 5"):
        csw.make_policy("optimal", csw.load_scenario("paper-1"))
    with pytest.raises(PolicyError, match="for 2 members, the swarm has 3"):
        policy().decide(0, np.zeros((1, 3, 2)), np.zeros((1, 3, 2)), np.ones((1, 3), bool))


def test_command_line_refuses_five_members(tmp_path):
    done = casswarm(tmp_path, "evaluate", "gauntlet", "--policy", "optimal", code=2)
    assert "two members" in done.stderr
    assert "Traceback" not in done.stderr
