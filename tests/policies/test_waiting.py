"""A guide that waits: its rule, by sampling, and what it does to a member that is behind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import DT, V_MAX, small, three_members

import casswarm as csw
from casswarm import Guide, Scenario

Array = NDArray[np.float64]
SIDE = V_MAX * DT  # of a step of the guide along an axis


def corner(**values: object) -> Scenario:
    """A member two units behind the guide's start, and a radar inside the guide's corner."""
    radar, target = (SIDE, 3 * SIDE), (5 * SIDE, 5 * SIDE)
    changes = {"swarm__a_max": 100.0, "guide__margin": 0.0, "hazard__alpha_1": 1.0} | values
    return small([(0.0, -3 * SIDE)], target, [radar], 20, **changes)


@cache
def around() -> Guide:
    """Guide from the origin up five steps, then five to the right."""
    velocities = np.repeat([[0.0, V_MAX], [V_MAX, 0.0]], 5, axis=0)
    positions = np.vstack([np.zeros((1, 2)), DT * velocities.cumsum(axis=0)])
    planned = csw.plan(corner(), certify=False)
    rates = corner().hazard.single_agent_rates(positions[1:])
    return replace(planned, positions=positions, velocities=velocities, rates=rates, arrives=True)


def leader(scenario: Scenario, **values: object) -> Any:
    return csw.make_policy("leader", scenario.with_values(dict(values)), around())


def waiting(steps: float) -> dict[str, float]:
    return {"guide.max_wait": steps * DT}


def sampled_goal(step: int, position: Array, most: int) -> Array:
    """The goal of the rule, from a fine sample of the path."""
    knots = np.array([around().reference(s) for s in range(step + 2)])
    s = np.linspace(max(0, step + 1 - most), step + 1, 4001)
    path = np.stack([np.interp(s, np.arange(step + 2), knots[:, axis]) for axis in (0, 1)], axis=1)
    distances = np.hypot(*(path - position).T)
    within = np.flatnonzero(distances <= np.sqrt(2) * SIDE)
    return path[within[-1] if within.size else np.argmin(distances)]


@pytest.mark.parametrize(("step", "most"), [(0, 3), (4, 2), (7, 10), (12, 4)])
def test_goal_is_the_farthest_point_of_the_guide_within_reach(step: int, most: int) -> None:
    policy = leader(corner(), **waiting(most))
    positions = np.random.default_rng(step).uniform(-2, 5, (40, 1, 2))
    found = policy.velocities(step, positions, np.zeros((40, 1, 2)), np.ones((40, 1), bool))
    goals = np.array([sampled_goal(step, position[0], most) for position in positions])
    expected = np.clip((goals - positions[:, 0]) / DT, -V_MAX, V_MAX)
    np.testing.assert_allclose(found[:, 0], expected, atol=5e-3 * V_MAX * most)


def test_guide_waits_no_longer_than_it_arrives_in_time() -> None:
    assert [leader(corner(), **waiting(k)).max_wait for k in (0, 2.5, 3, 1e6)] == [0, 2, 3, 10]
    late = corner(time__t_f=9 * DT)
    assert leader(late, **waiting(3)).max_wait == 0


def test_guide_does_not_wait_for_a_leader_on_schedule() -> None:
    policies = [leader(corner(), **waiting(steps)) for steps in (0, 10)]
    alive = np.ones((1, 1), bool)
    for step, (here, before) in enumerate(
        zip(around().positions[1:-1], around().velocities, strict=False), 1
    ):
        never, waits = (
            policy.velocities(step, here[None, None], before[None, None], alive)
            for policy in policies
        )
        np.testing.assert_array_equal(never, waits)


def test_member_far_behind_arrives_only_if_the_guide_waits() -> None:
    success = [
        csw.evaluate(corner(), leader(corner(), **waiting(steps)), guide=around()).success
        for steps in (0, 4)
    ]
    assert success[0].high < 1e-6  # it flies through the radar, towards the guide beyond it
    assert success[1].low > 0.5


@pytest.mark.parametrize(
    "name",
    [
        "leader",
        "constrained",
        "constrained-mpc-2",
        pytest.param("leader-mpc-3", marks=pytest.mark.slow),
    ],
)
def test_evaluate_is_within_the_interval_of_simulate_if_the_guide_waits(name: str) -> None:
    scenario = three_members(time__t_f=14 * DT, guide__max_wait=2 * DT, guide__search="local")
    guide = csw.plan(scenario.with_values({"time.t_f": 9 * DT}), certify=False)
    policy = csw.make_policy(name, scenario, guide)
    bounds = csw.evaluate(scenario, policy, guide=guide, tolerance=1e-3).success
    row = csw.simulate(scenario, policy, 400, guide=guide).summary.iloc[0]
    assert policy.max_wait == 2  # type: ignore[attr-defined]
    assert row["success_low"] <= bounds.high
    assert bounds.low <= row["success_high"]
