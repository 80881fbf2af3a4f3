"""User policies: functions, objects and subclasses; invalid and irrepeatable ones."""

from __future__ import annotations

from functools import cache
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from small_scenarios import DT, Array, small

import casswarm as csw
from casswarm import Decision, Guide, Policy, plan, simulate
from casswarm.policies import as_policy, repeated

CENTER = np.array([3.0, 0.0])
SCENARIO = small([(0.0, 0.0), (0.3, 0.2)], (3.0, 0.0), [(1.5, 1.0)], 12, guide__search="local")


@cache
def guide() -> Guide:
    return plan(SCENARIO)


def study_of(*policies: Any) -> pd.DataFrame:
    return simulate(SCENARIO, policies, runs=200, seed=3, guide=guide()).runs


# --- the same policy in three forms


def straight_on(_step: int, positions: Array, *_: Any) -> Array:
    """Function: all members move to the target, as fast as the limits allow."""
    return np.clip((CENTER - positions) / DT, -2.0, 2.0)


class StraightOn:
    """Object with a method `velocities`."""

    def velocities(self, *state: Any) -> Array:
        return straight_on(*state)


class StraightOnPolicy(Policy):
    """Subclass of `Policy`, which also reports counts."""

    name = "subclass"

    def decide_batch(self, *state: Any) -> Decision:
        velocities = straight_on(*state)
        none = Decision.plain(velocities)
        return Decision(velocities, none.infeasible + 2, none.failures + 1, none.fallbacks)


def test_function_object_and_subclass_simulate_alike() -> None:
    runs = study_of(straight_on, StraightOn(), StraightOnPolicy())
    names = ["straight_on", "StraightOn", "subclass"]
    assert runs["policy"].drop_duplicates().tolist() == names
    tables = [
        runs[runs["policy"] == name]
        .drop(columns=["policy", "infeasible", "solver_failures"])
        .reset_index(drop=True)
        for name in names
    ]
    assert 0 < tables[0]["success"].sum() < 200
    for table in tables[1:]:
        pd.testing.assert_frame_equal(table, tables[0])


def test_decision_counts_appear_in_tables() -> None:
    runs = study_of(StraightOnPolicy(), straight_on, "leader")
    assert set(runs["policy"]) == {"subclass", "straight_on", "leader"}
    own = runs[runs["policy"] == "subclass"]
    assert (own["infeasible"] == 2 * own["steps"]).all()
    assert (own["solver_failures"] == own["steps"]).all()
    plain = runs[runs["policy"] == "straight_on"]
    assert plain["infeasible"].sum() == plain["solver_failures"].sum() == 0


def test_as_policy_name_defaults_to_function_or_class() -> None:
    named = SimpleNamespace(name="mine", velocities=straight_on)
    assert as_policy(straight_on).name == "straight_on"
    assert as_policy(StraightOn()).name == "StraightOn"
    assert as_policy(named).name == "mine"
    assert as_policy(straight_on, name="other").name == "other"
    policy = StraightOnPolicy()
    assert as_policy(policy) is policy


def test_velocities_of_destroyed_are_ignored() -> None:
    def careless(*state: Any) -> Array:
        velocities = straight_on(*state)
        velocities[~state[3]] = np.nan
        return velocities

    runs = study_of(careless, straight_on).drop(columns="policy")
    assert (runs["survivors"] == 1).any()  # a member was destroyed before the end
    first, second = runs[:200], runs[200:].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, second)


# --- policies that answer the same state differently


GENERATOR = np.random.default_rng(0)
CALLS = count()


def straight(positions: Array) -> Array:
    return np.clip((CENTER - positions) / DT, -1.5, 1.5)


def drawn(_step: int, positions: Array, *_: Any) -> Array:
    return straight(positions) + 0.1 * GENERATOR.normal(size=positions.shape)


def drawn_by_place(step: int, positions: Array, *_: Any) -> Array:
    return straight(positions) + 0.1 * np.random.default_rng(step).normal(size=positions.shape)


def remembering(_step: int, positions: Array, *_: Any) -> Array:
    return straight(positions) / (1 + 0.01 * next(CALLS))


def drawn_by_state(_step: int, positions: Array, *_: Any) -> Array:
    seeds = [np.frombuffer(state.tobytes(), np.uint32) for state in positions]
    noise = [np.random.default_rng(seed).normal(size=positions.shape[1:]) for seed in seeds]
    return straight(positions) + 0.1 * np.array(noise)


def rounded(_step: int, positions: Array, *_: Any) -> Array:
    return straight(positions) + 1e-12 * len(positions)


@cache
def noise() -> Policy:
    rng = np.random.default_rng(0)
    return as_policy(lambda o: rng.normal(size=(*o.shape[:2], 2)), SCENARIO, name="noise")


@pytest.mark.parametrize("policy", [drawn, drawn_by_place, remembering, noise])
def test_policy_that_answers_a_state_differently_is_refused(policy: Any) -> None:
    name, policy = policy.__name__, noise() if policy is noise else policy
    for function in (csw.evaluate, csw.estimate, csw.simulate, csw.runs_needed):
        with pytest.raises(csw.PolicyCallError, match="seeded from the state") as caught:
            function(SCENARIO, policy, guide=guide())
        assert f"policy '{name}' answers the same state differently at step" in str(caught.value)
        assert caught.value.policy == name


@pytest.mark.parametrize("policy", [drawn_by_state, rounded])
def test_policy_that_depends_on_the_state_alone_is_evaluated(policy: object) -> None:
    distribution = csw.evaluate(SCENARIO, policy, tolerance=0.1, guide=guide())
    assert distribution.residual_mass <= 0.1
    assert distribution.policy == policy.__name__  # type: ignore[attr-defined]


def test_own_policies_are_asked_once() -> None:
    own = csw.make_policy("naive", SCENARIO, guide())
    assert repeated(own) is own
    assert repeated(csw.as_policy(drawn)) != csw.as_policy(drawn)
    limited = csw.as_policy(drawn, time_limit=1.0)
    assert repeated(limited) != limited
