"""News that is late: the law with ghosts by hand and by brute force, and what must not change."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import abreast, pair

import casswarm as csw
from casswarm.errors import ScenarioError
from casswarm.guide.agent import initial_velocities

Array = NDArray[np.float64]
POLICIES = ("naive", "leader", "constrained")


def with_delay(scenario: csw.Scenario, delay: int | str) -> csw.Scenario:
    return scenario.replace(information={"delay": delay})


def delayed_law(scenario: csw.Scenario, policy: csw.Policy, previous: Array, delay: int) -> float:
    """Success by recursion over all losses: state, who lives, and who lived at every step."""
    dt, steps, n = scenario.time.dt, scenario.n_steps, scenario.n
    center, radius = np.array(scenario.target.center), scenario.target.radius

    def follow(x: Array, v: Array, lived: list[tuple[bool, ...]], weight: float) -> float:
        step, alive = len(lived) - 1, np.array(lived[-1])
        if step == steps or not alive.any():
            return 0.0
        believed = np.array(lived[max(0, step - delay)])
        x, v = x * believed[:, None], v * believed[:, None]
        moves = policy.velocities(step, x, v, believed)
        after = x + dt * moves
        survival = np.exp(-dt * scenario.hazard.rates(after, alive))
        inside = np.hypot(*(after - center).T) <= radius
        total = 0.0
        for fate in product((False, True), repeat=n):
            lives = np.array(fate)
            if (lives & ~alive).any():
                continue
            share = weight * float(np.prod(np.where(lives, survival, 1 - survival)[alive]))
            if (lives & inside).any():
                total += share
            elif share > 0.0:
                total += follow(after, moves, [*lived, fate], share)
        return total

    return follow(scenario.positions, previous, [(True,) * n], 1.0)


# --- known answers


def test_two_members_and_three_steps_by_hand() -> None:
    """One flies past the radar; the other one turns to the target once it knows that it is alone.

    It arrives in three steps if it turns after the first, and in no other case.
    """
    scenario = pair(3, swarm__a_max=50.0, swarm__velocity=[0.0, 0.0]).with_values(
        {
            "swarm.positions": [[0.0, 0.0], [0.0, 1.0]],
            "target.center": [1.2, 1.0],
            "target.radius": 0.3,
            "hazard.radars": [[0.0, -0.9]],
        }
    )
    dt = scenario.time.dt

    def decide(step: int, x: Array, _: Array, alive: Any) -> Array:  # noqa: ARG001
        away, toward = np.array([0.0, -0.1]), np.array([1.9, 0.0])
        alone = alive[:, 1] & ~alive[:, 0]
        second = np.where(alone[:, None], toward, 0.0)
        return np.stack([np.tile(away, (len(x), 1)), second], axis=1) * alive[..., None]

    def rates(x: list[list[float]], alive: list[bool]) -> Array:
        return np.asarray(scenario.hazard.rates(np.array(x), np.array(alive)))

    first, ghost = [0.0, -0.1 * dt], [0.0, 0.0]
    both = np.exp(-dt * rates([first, [0.0, 1.0]], [True, True]))
    lost = (1 - both[0]) * both[1]  # the first one, in the first step, and not the second
    alone = [0.0, 1.0 * dt], [1.9 * dt, 1.0], [2 * 1.9 * dt, 1.0]
    survival = [math.exp(-dt * rates([ghost, list(at)], [False, True])[1]) for at in alone[1:]]
    arrives = math.dist(alone[2], scenario.target.center) <= 0.3
    assert arrives
    assert not math.dist(alone[1], scenario.target.center) <= 0.3
    expected = lost * survival[0] * survival[1]
    for delay, value in ((0, expected), (1, 0.0), ("never", 0.0)):
        found = csw.evaluate(with_delay(scenario, delay), decide, 0.0, aggregation_tol=0.0).success
        assert found.low == pytest.approx(value, rel=1e-12)
        assert found.high == pytest.approx(value, rel=1e-12)
    assert expected > 0.001


@pytest.mark.parametrize("name", POLICIES)
@pytest.mark.parametrize("delay", [1, 2, 3])
def test_exact_law_equals_brute_force(name: str, delay: int) -> None:
    scenario = with_delay(abreast(3, steps=6), delay)
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy(name, scenario, guide)
    law = delayed_law(scenario, policy, initial_velocities(scenario, guide), delay)
    exact = csw.evaluate(scenario, policy, 0.0, guide=guide, aggregation_tol=0.0).success
    assert exact.low == pytest.approx(law, abs=1e-12)
    assert exact.high == pytest.approx(law, abs=1e-12)


@pytest.mark.parametrize("delay", [2, "never"])
def test_sampled_frequency_agrees_with_the_law(delay: int | str) -> None:
    scenario = with_delay(abreast(3), delay)
    exact = csw.evaluate(scenario, "leader", 1e-6).success
    runs = csw.simulate(scenario, ["leader"], 20_000, seed=3).summary.iloc[0]
    error = 4.0 * math.sqrt(exact.low * (1 - exact.low) / 20_000)
    assert abs(runs.success - exact.low) < error
    estimate = csw.estimate(scenario, "leader", 4000, seed=1, max_states=20).success
    assert estimate.low - 0.02 < exact.low < estimate.high + 0.02


# --- what does not change


@pytest.mark.parametrize("name", ["naive", "joint"])
def test_policies_that_do_not_look_have_the_same_law(name: str) -> None:
    """`joint` is a blind plan: its law with news that never come is today's."""
    scenario = abreast(3)
    policy = csw.make_policy(name, scenario)
    lows = [
        csw.evaluate(with_delay(scenario, delay), policy, 0.0).success.low
        for delay in (0, 1, 3, "never")
    ]
    assert lows == pytest.approx([lows[0]] * 4, rel=1e-12)


def test_delay_longer_than_the_run_is_never() -> None:
    scenario = abreast(3)
    found = [
        csw.evaluate(with_delay(scenario, delay), "leader", 0.0).success
        for delay in (scenario.n_steps, scenario.n_steps + 5, "never")
    ]
    assert found[0] == found[1] == found[2]


def test_ghosts_add_no_density_and_have_no_rate() -> None:
    """The survivor of two that fly together has the rate of one alone, whoever it believes in."""
    scenario = with_delay(pair(4), "never")
    guide = csw.plan(scenario, certify=False)
    law = csw.evaluate(scenario, "naive", 0.0, guide=guide)
    truth = csw.evaluate(with_delay(scenario, 0), "naive", 0.0, guide=guide)
    np.testing.assert_allclose(law.survivors, truth.survivors, rtol=1e-12)
    np.testing.assert_allclose(law.members, truth.members, rtol=1e-12)


# --- two members


@pytest.mark.slow
def test_optimal_values_of_two_members_are_in_order() -> None:
    """never <= d + 1 <= d <= 0 <= the bound of all policies, as far as the brackets tell."""
    scenario = pair(6, swarm__velocity=[1.0, 0.0])
    bound = csw.success_bound(scenario).value
    values = [
        csw.optimal_value(scenario, 0.01, time_limit=0.8, delay=delay).success
        for delay in (0, 1, 2, "never")
    ]
    # upper ends end by the clock, and each of them is of policies that know losses at once
    assert max(value.low for value in values) <= min(value.high for value in values)
    assert values[-1].low <= min(value.low for value in values)
    assert all(value.low <= bound for value in values)
    blind = csw.plan_swarm(scenario, certify=False).success
    assert values[-1].low >= blind.low - 1e-12
    with pytest.raises(ScenarioError, match="a whole number of steps"):
        csw.optimal_value(scenario, delay=-1)


# --- wrong values, and parts that do not treat it


@pytest.mark.parametrize("value", [-1, 1.5, "sometimes", True])
def test_wrong_delays_are_refused(value: object) -> None:
    with pytest.raises(ScenarioError, match="a whole number of steps from 0") as caught:
        abreast(2).replace(information={"delay": value})
    assert caught.value.key == "information.delay"


def test_sweep_over_delays() -> None:
    table = csw.sweep(
        abreast(3), {"information.delay": [0.0, 2.0]}, policies=["leader"], runs=50
    ).table
    assert table["information.delay"].tolist() == [0, 2]
