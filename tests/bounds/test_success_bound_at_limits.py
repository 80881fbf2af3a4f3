"""The bound on all policies where a target is just within reach, or far out of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from small_scenarios import (
    ALPHA,
    small,
)

from casswarm import evaluate, load_scenario, plan, success_bound

FACTOR = (1 + ALPHA[1]) / (1 + 3 * ALPHA[1])  # least relative rate among three


@pytest.mark.parametrize(("v_max", "length"), [(2.0, 1.0), (1e-8, 1e-8)])
@pytest.mark.parametrize("beyond", [4e-10, 1e-10, 1e-12, 0.0])
def test_success_bound_holds_for_policies_that_ask_for_more_than_v_max(
    v_max: float, length: float, beyond: float
) -> None:
    scenario = load_scenario("single-agent")
    radius, steps = 0.5 * length, 10
    reach = steps * scenario.time.dt * v_max
    scenario = scenario.with_values(
        {
            "swarm.v_max": v_max,
            "swarm.velocity": [v_max, 0.0],
            "target.center": [(1 + beyond) * reach + radius, 0.0],
            "target.radius": radius,
            "time.t_f": steps * scenario.time.dt * (1 + 1e-9),
            "hazard.radars": [[0.5 * reach, 3.0 * length + 0.02]],
        }
    )
    guide = plan(scenario, certify=False, check=False)

    def hasty(_step, positions, _previous_velocities, _alive):  # type: ignore[no-untyped-def]
        return np.broadcast_to([v_max + 0.9e-9, 0.0], positions.shape)

    success = evaluate(scenario, hasty, guide=guide).success
    assert success.low <= float(success_bound(scenario))


@pytest.mark.parametrize("far", [1e4, 1e9, 1e15])
def test_success_bound_member_out_of_reach_does_not_count(far: float) -> None:
    members = [(0.0, 0.0), (0.1, 0.0)]
    two, three = (
        small([*members, *others], (3.0, 0.5), [(1.5, 1.3)], 10) for others in ([], [(far, -far)])
    )
    three = three.with_values({"hazard.alpha_2": 0.0})
    two = two.with_values({"hazard.alpha_2": 0.0})
    bounds = success_bound(two, 20_000), success_bound(three, 20_000)
    assert bounds[1].risks[2] == math.inf
    assert bounds[1].failure == pytest.approx(bounds[0].failure, rel=0.02)
