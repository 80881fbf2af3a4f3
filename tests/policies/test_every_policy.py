"""Properties of every policy: its limits, its answers to states, pickling, and its exact law."""

from __future__ import annotations

import pickle

import cloudpickle
import numpy as np
import pytest
from policy_cases import guide, policy, scenario, states

import casswarm as csw
from casswarm.policies import POLICIES

TURNED = ["leader", "constrained", "leader-feedback", "constrained-feedback"]
"""Policies whose members have no paths of their own."""
NAMES = [*POLICIES, "parametric", "model"]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "joint-replanning" else ())
        for name in NAMES
        if name != "model"  # whose velocities the chain projects
    ],
)
def test_decision_respects_hard_constraints(name):
    positions, previous_velocities, alive = states(name, 40, seed=0)
    velocities = policy(name).decide(2, positions, previous_velocities, alive).velocities
    assert velocities.shape == positions.shape
    assert np.abs(velocities[alive]).max() <= 2.0
    changes = np.hypot(*(velocities - previous_velocities)[alive].T)
    assert changes.max() <= np.sqrt(0.5) + 1e-9
    assert (velocities[~alive] == 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_answer_to_a_state_is_the_same_in_every_batch(name):
    """Also to a state without an axis of the batch, and as velocities alone."""
    state = states(name, 9, seed=1)
    together = policy(name).decide(2, *state)
    np.testing.assert_array_equal(policy(name).velocities(2, *state), together.velocities)
    for rows in (slice(3, 8), *(slice(b, b + 1) for b in range(9))):
        part = policy(name).decide(2, *(each[rows] for each in state))
        for field in ("velocities", "infeasible", "failures"):
            np.testing.assert_array_equal(getattr(part, field), getattr(together, field)[rows])
        assert not part.failures.any()
    for b in range(9):
        alone = tuple(each[b] for each in state)
        np.testing.assert_array_equal(policy(name).velocities(2, *alone), together.velocities[b])
        decision = policy(name).decide(2, *alone)
        np.testing.assert_array_equal(decision.velocities, together.velocities[b : b + 1])
    assert policy(name).name == name


@pytest.mark.parametrize("name", NAMES)
def test_policy_pickles(name):
    state, by = states(name, 5, seed=3), cloudpickle if name == "parametric" else pickle
    again = pickle.loads(by.dumps(policy(name)))
    np.testing.assert_array_equal(again.velocities(2, *state), policy(name).velocities(2, *state))


BY_IPOPT = [f"{name}, ipopt" for name in ("naive", "leader-mpc-2", *TURNED)]


@pytest.mark.parametrize("name", [*NAMES, *BY_IPOPT])
def test_empty_batch_has_empty_decision(name):
    none, n = np.zeros((0, scenario(name).n, 2)), scenario(name).n
    decision = policy(name).decide(0, none, none, np.zeros((0, n), bool))
    assert decision.velocities.shape == none.shape
    assert decision.failures.shape == decision.infeasible.shape == (0,)


@pytest.mark.parametrize("missing", [(np.nan, np.nan), (np.inf, -np.inf)])
@pytest.mark.parametrize("name", NAMES)
def test_entries_of_destroyed_members_may_be_missing(name, missing):
    positions, previous_velocities, alive = states(name, 5, seed=5)
    expected = policy(name).velocities(2, positions, previous_velocities, alive)
    positions[~alive] = previous_velocities[~alive] = missing
    found = policy(name).velocities(2, positions, previous_velocities, alive)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", TURNED)
def test_order_of_members_is_that_of_their_velocities(name):
    state, order = states(name, 30, seed=2), [2, 0, 3, 1]
    expected = policy(name).velocities(3, *state)[:, order]
    found = policy(name).velocities(3, *(each[:, order] for each in state))
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "tolerance", "runs"),
    [
        pytest.param("optimal", 0.0, 4000, marks=pytest.mark.slow),
        ("joint", 0.0, 4000),
        ("parametric", 1e-6, 2000),
        ("leader-feedback", 1e-3, 1000),
        ("model", 1e-2, 500),
    ],
)
def test_exact_success_agrees_with_runs(name, tolerance, runs):
    of, lattice = scenario(name), 1e-6 if name == "leader-feedback" else None
    options = {"aggregation_tol": lattice, "guide": guide(name)}
    law = csw.evaluate(of, policy(name), tolerance, **options).success
    assert law.width <= tolerance + 1e-9
    assert law.low <= csw.success_bound(of).value
    row = csw.simulate(of, [policy(name)], runs, seed=1, guide=guide(name)).summary.iloc[0]
    assert row["policy"] == name
    assert row["success_low"] <= law.high
    assert law.low <= row["success_high"]
    assert row["solver_failures"] == 0
    assert row["saturated"] == (runs if name == "model" else 0)
