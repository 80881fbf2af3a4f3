"""User policies: functions, objects and subclasses; invalid and irrepeatable ones."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from small_scenarios import DT, Array, small

import casswarm as csw
from casswarm import Decision, Guide, Policy, PolicyError, Scenario, plan, simulate
from casswarm.policies import UserPolicy, as_policy, repeated

Flags = NDArray[np.bool_]
CENTER = np.array([3.0, 0.0])


@cache
def scenario() -> Scenario:
    return small([(0.0, 0.0), (0.3, 0.2)], (3.0, 0.0), [(1.5, 1.0)], 12, guide__search="local")


@cache
def guide() -> Guide:
    return plan(scenario())


def study_of(*policies: Any) -> pd.DataFrame:
    return simulate(scenario(), policies, runs=200, seed=3, guide=guide()).runs


# --- the same policy in three forms


def straight_on(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    """Function: all members move to the target, as fast as the limits allow."""
    return np.clip((CENTER - positions) / DT, -2.0, 2.0)


class StraightOn:
    """Object with a method `velocities`."""

    def velocities(
        self, step: int, positions: Array, previous_velocities: Array, alive: Flags
    ) -> Array:
        return straight_on(step, positions, previous_velocities, alive)


class StraightOnPolicy(Policy):
    """Subclass of `Policy`, which also reports counts."""

    name = "subclass"

    def decide_batch(
        self, step: int, positions: Array, previous_velocities: Array, alive: Flags
    ) -> Decision:
        velocities = straight_on(step, positions, previous_velocities, alive)
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
    runs = study_of(StraightOnPolicy(), straight_on)
    own = runs[runs["policy"] == "subclass"]
    assert (own["infeasible"] == 2 * own["steps"]).all()
    assert (own["solver_failures"] == own["steps"]).all()
    plain = runs[runs["policy"] == "straight_on"]
    assert plain["infeasible"].sum() == plain["solver_failures"].sum() == 0


def test_simulate_mixes_user_and_named_policies() -> None:
    runs = study_of("leader", straight_on)
    assert set(runs["policy"]) == {"leader", "straight_on"}


def test_as_policy_name_defaults_to_function_or_class() -> None:
    named = SimpleNamespace(name="mine", velocities=straight_on)
    assert as_policy(straight_on).name == "straight_on"
    assert as_policy(StraightOn()).name == "StraightOn"
    assert as_policy(named).name == "mine"
    assert as_policy(straight_on, name="other").name == "other"


def test_as_policy_returns_policy_unchanged() -> None:
    policy = StraightOnPolicy()
    assert as_policy(policy) is policy


# --- invalid velocities and policies

Spoil = Callable[[Array], Any]


def nan_of_member_1(velocities: Array) -> Array:
    velocities[:, 1, 0] = np.nan
    return velocities


WRONG: dict[str, tuple[Spoil, str]] = {
    "a state's worth": (lambda v: v[0], r"shape \(2, 2\) at step 3; expected \(\d+, 2, 2\)"),
    "one velocity": (lambda v: v[0, 0], r"shape \(2,\) at step 3"),
    "a member more": (lambda v: np.repeat(v, 2, axis=1), r"shape \(\d+, 4, 2\) at step 3"),
    "NaN": (nan_of_member_1, r"velocity \[nan .* for member 1 at step 3"),
    "infinity": (lambda v: v + np.inf, r"velocity \[inf inf\] for member \d at step 3"),
}


@pytest.mark.parametrize("form", ["function", "subclass"])
@pytest.mark.parametrize(("spoil", "message"), WRONG.values(), ids=WRONG.keys())
def test_invalid_velocities_raise_error_with_policy_and_step(
    form: str, spoil: Spoil, message: str
) -> None:
    def spoiled(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:
        velocities = straight_on(step, positions, previous_velocities, alive)
        return spoil(velocities) if step == 3 else velocities

    class Spoiled(Policy):
        name = "spoiled"

        def decide_batch(
            self, step: int, positions: Array, previous_velocities: Array, alive: Flags
        ) -> Decision:
            return Decision.plain(spoiled(step, positions, previous_velocities, alive))

    with pytest.raises(PolicyError, match="policy 'spoiled' .*" + message) as caught:
        study_of(spoiled if form == "function" else Spoiled())
    assert (caught.value.policy, caught.value.step) == ("spoiled", 3)


def test_velocities_of_destroyed_are_ignored() -> None:
    def careless(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:
        velocities = straight_on(step, positions, previous_velocities, alive)
        velocities[~alive] = np.nan
        return velocities

    runs = study_of(careless, straight_on).drop(columns="policy")
    assert (runs["survivors"] == 1).any()  # a member was destroyed before the end
    first, second = runs[:200], runs[200:].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, second)


@pytest.mark.parametrize("nonsense", [3, None, {"velocities": 1}, SimpleNamespace(velocities=1)])
def test_as_policy_of_other_object_raises_policy_error(nonsense: object) -> None:
    with pytest.raises(PolicyError, match="expected a name, a function of"):
        as_policy(nonsense)


def test_as_policy_of_class_asks_for_instance() -> None:
    for policy in (StraightOn, StraightOnPolicy):
        with pytest.raises(PolicyError, match=rf"pass an instance: {policy.__name__}\(\)"):
            as_policy(policy)


def test_policy_without_name_raises_policy_error() -> None:
    class Nameless(Policy):
        decide_batch = StraightOnPolicy.decide_batch

    with pytest.raises(PolicyError, match="define one in its class: name = 'mine'"):
        study_of(Nameless())


def test_user_policy_checks_velocities_in_decide() -> None:
    policy = UserPolicy(lambda *_: np.zeros((1, 2)), "short")
    state = (np.zeros((4, 2, 2)), np.zeros((4, 2, 2)), np.ones((4, 2), bool))
    with pytest.raises(PolicyError, match=r"'short' .* \(1, 2\) at step 7; expected \(4, 2, 2\)"):
        policy.decide(7, *state)


# --- policies that answer the same state differently


GENERATOR = np.random.default_rng(0)
CALLS = count()


def straight(positions: Array) -> Array:
    return np.clip((CENTER - positions) / DT, -1.5, 1.5)


def drawn(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    return straight(positions) + 0.1 * GENERATOR.normal(size=positions.shape)


def drawn_by_place(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    return straight(positions) + 0.1 * np.random.default_rng(step).normal(size=positions.shape)


def remembering(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    return straight(positions) / (1 + 0.01 * next(CALLS))


def drawn_by_state(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    seeds = [np.frombuffer(state.tobytes(), np.uint32) for state in positions]
    noise = [np.random.default_rng(seed).normal(size=positions.shape[1:]) for seed in seeds]
    return straight(positions) + 0.1 * np.array(noise)


def rounded(step: int, positions: Array, previous_velocities: Array, alive: Flags) -> Array:  # noqa: ARG001
    return straight(positions) + 1e-12 * len(positions)


@pytest.mark.parametrize("policy", [drawn, drawn_by_place, remembering])
def test_policy_that_answers_a_state_differently_is_refused(policy: object) -> None:
    for function in (csw.evaluate, csw.estimate):
        with pytest.raises(csw.PolicyCallError, match="simulate accepts this one") as caught:
            function(scenario(), policy, guide=guide())
        name = policy.__name__  # type: ignore[attr-defined]
        assert f"policy '{name}' answers the same state differently at step" in str(caught.value)
        assert caught.value.policy == name


def test_random_policy_is_simulated() -> None:
    study = csw.simulate(scenario(), [drawn], runs=20, guide=guide())
    assert len(study.runs) == 20


@pytest.mark.parametrize("policy", [drawn_by_state, rounded])
def test_policy_that_depends_on_the_state_alone_is_evaluated(policy: object) -> None:
    distribution = csw.evaluate(scenario(), policy, tolerance=0.1, guide=guide())
    assert distribution.residual_mass <= 0.1
    assert distribution.policy == policy.__name__  # type: ignore[attr-defined]


def test_own_policies_are_asked_once() -> None:
    own = csw.make_policy("naive", scenario(), guide())
    assert repeated(own) is own
    assert repeated(csw.as_policy(drawn)) != csw.as_policy(drawn)
    limited = csw.as_policy(drawn, time_limit=1.0)
    assert repeated(limited) != limited
