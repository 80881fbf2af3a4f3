"""States that policies are given: empty batches, and numbers of the destroyed and the living."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw

SCENARIO = small(
    [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3)], (3.0, 0.5), [(1.5, 1.3)], 8, guide__a_max=0.3
)
NAMES = ("naive", "leader", "constrained", "leader-mpc-2", "leader-feedback")
SOLVERS = ("auto", "ipopt")


def made(name: str, solver: str) -> csw.Policy:
    guide = csw.plan(SCENARIO, certify=False)
    return csw.make_policy(name, SCENARIO, guide, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", NAMES)
def test_empty_batch_has_empty_decision(name: str, solver: str) -> None:
    none = np.zeros((0, 3, 2))
    decision = made(name, solver).decide(0, none, none, np.zeros((0, 3), bool))
    assert decision.velocities.shape == (0, 3, 2)
    assert decision.failures.shape == decision.infeasible.shape == (0,)


@pytest.mark.parametrize("missing", [(np.nan, np.nan), (np.inf, -np.inf)])
@pytest.mark.parametrize("name", NAMES)
def test_entries_of_destroyed_members_may_be_missing(
    name: str, missing: tuple[float, float]
) -> None:
    policy, alive = made(name, "auto"), np.array([[True, False, True], [True, True, True]])
    positions, velocities = np.stack([SCENARIO.positions] * 2), np.zeros((2, 3, 2))
    positions[0, 1] = 0.0
    expected = policy.velocities(0, positions, velocities, alive)
    positions[0, 1] = velocities[0, 1] = missing
    np.testing.assert_array_equal(policy.velocities(0, positions, velocities, alive), expected)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_living_members_have_finite_states(value: float) -> None:
    positions = SCENARIO.positions.copy()
    positions[1, 0] = value
    for state in ((positions, np.zeros((3, 2))), (SCENARIO.positions, positions)):
        with pytest.raises(csw.PolicyError, match="living members are not finite at step 4"):
            made("leader", "auto").decide(4, *state, np.ones(3, bool))
