"""Policies that answer the same state differently: refused by exact distributions."""

from __future__ import annotations

from functools import cache
from itertools import count

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import DT, Array, small

import casswarm as csw
from casswarm.policies import repeated

Flags = NDArray[np.bool_]
CENTER = np.array([3.0, 0.0])
GENERATOR = np.random.default_rng(0)
CALLS = count()


@cache
def scenario() -> csw.Scenario:
    return small([(0.0, 0.0), (0.3, 0.2)], (3.0, 0.0), [(1.5, 1.0)], 8, guide__search="local")


@cache
def guide() -> csw.Guide:
    return csw.plan(scenario(), certify=False)


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
