"""The bound on every policy: lemmas, known answers, and policies that do not exceed it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import (
    ALPHA,
    DT,
    V_MAX,
    Array,
    Point,
    patrolled,
    single_agent_rate_by_hand,
    small,
)

from casswarm import (
    Saturation,
    SaturationCollision,
    Scenario,
    SuccessBound,
    evaluate,
    load_scenario,
    plan,
    plan_swarm,
    success_bound,
)
from casswarm.bounds import certify
from casswarm.grid import Relaxation
from casswarm.hazard.rate_bounds import LeastRate
from casswarm.joint import PlanDistribution
from casswarm.policies import JointPolicy

FACTOR = (1 + ALPHA[1]) / (1 + 3 * ALPHA[1])  # least relative rate among three


def some_scenario(rng: np.random.Generator, n: int, steps: int, collides: bool) -> Scenario:
    """Members around the origin and a target that the first of them can reach."""
    far = rng.uniform(0.75, 0.9 * steps * DT * V_MAX + 0.3)
    angle = rng.uniform(0, 2 * np.pi)
    target = (float(far * np.cos(angle)), float(far * np.sin(angle)))
    spread = min(0.5, 0.9 * (far - 0.7))  # outside the target, with the first one central
    starts = rng.uniform(-1.0, 1.0, (n, 2)) * spread
    starts -= starts.mean(axis=0) if n > 1 else starts[0]
    starts *= min(1.0, spread / max(1e-9, np.hypot(*starts.T).max()))
    starts[0] *= 0.0
    radars: list[Point] = []
    while len(radars) < int(rng.integers(1, 4)):
        x, y = rng.uniform(-1, 3, 2)
        if np.hypot(*(starts - [x, y]).T).min() > 0.15:
            radars.append((float(x), float(y)))
    values: dict[str, object] = {"swarm__velocity": (0.0, 0.0), "swarm__a_max": 100.0}
    if collides:
        values |= {"hazard__kind": "saturation+collision"}
        values |= {"hazard__beta_1": 0.2, "hazard__beta_2": 6.0}
    positions = [(float(x), float(y)) for x, y in starts]
    return small(positions, target, radars, steps, **values)


def adversary(scenario: Scenario, rng: np.random.Generator) -> Array:
    """Ways (N+1, n, 2) to the target by a random bend, at random distances from one another."""
    steps, n = scenario.n_steps, scenario.n
    goal = np.array(scenario.target.center)
    bend = 0.5 * goal + rng.normal(0, 0.5, 2) * rng.integers(0, 2)
    spread = rng.choice([0.0, 0.02, 0.2, 0.5]) * rng.normal(size=(n, 2))
    path = np.empty((steps + 1, n, 2))
    path[0] = scenario.positions
    for t in range(1, steps + 1):
        goal_at_step = (bend if 2 * t < steps else goal) + spread * (t < steps)
        reach = 0.999999 * DT * V_MAX
        path[t] = path[t - 1] + np.clip(goal_at_step - path[t - 1], -reach, reach)
    return path


# --- never below


@pytest.mark.parametrize("collides", [False, True])
@pytest.mark.parametrize("n", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3, 4))])
def test_success_bound_exceeds_random_open_loop_plans(n: int, collides: bool) -> None:
    rng = np.random.default_rng([n, collides])
    near = 0
    for _ in range(40):
        scenario = some_scenario(rng, n, int(rng.integers(1, 7)), collides)
        bound = success_bound(scenario, 20_000, max_work=1e4)
        assert bound.certified
        largest = 0.0
        for _ in range(6):
            paths = adversary(scenario, rng)
            largest = max(largest, PlanDistribution.from_positions(scenario, paths).success[1])
        assert largest <= bound.value
        near += largest > bound.value - 0.1
    assert near > 0  # the bound is not just 1


@pytest.mark.parametrize("seed", range(4))
def test_success_bound_exceeds_policies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scenario = some_scenario(rng, 1 + seed % 3, 6, seed % 2 == 1)
    bound = success_bound(scenario, 50_000, max_work=1e6)
    guide = plan(scenario, certify=False, search="global")
    best = plan_swarm(scenario, guide=guide, initial_guesses=["formations"])
    assert best.success is not None
    assert best.success[1] <= bound.value
    policies = ["naive", "constrained", "leader", "leader-feedback", JointPolicy.from_plan(best)]
    for policy in policies:
        distribution = evaluate(scenario, policy, 1e-3, guide=guide)
        assert distribution.success[0] <= bound.value


@pytest.mark.parametrize("name", ["paper-1", "paper-2", "gauntlet"])
def test_success_bound_exceeds_leader_on_paper_scenarios(name: str) -> None:
    scenario = load_scenario(name)
    bound = float(success_bound(scenario))
    leader = evaluate(scenario, "leader", 1e-2, max_states=20_000)  # a lower end suffices
    assert leader.success.low < bound < 1.0


# --- known answers


def test_success_bound_single_member_matches_risk_bound() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.0), [(1.4, 1.0)], 8)
    task = Relaxation.from_scenario(scenario)
    guide = plan(scenario, search="global")
    certified = certify(task, guide.risk, gap=1e-4, time_limit=10.0).bound
    bound = success_bound(scenario, 2_000_000)
    assert bound.risks[0] == pytest.approx(certified, rel=5e-3)
    assert bound.value == pytest.approx(math.exp(-bound.risks[0]), abs=1e-12)
    assert bound.value >= guide.survival


def test_success_bound_is_attained_in_one_step() -> None:
    """Three members at one position take one step together, with the best possible protection."""
    radar, reach = (4.0, 0.3), DT * V_MAX
    scenario = small([(0.0, 0.0)] * 3, (0.9, 0.0), [radar], 1, swarm__a_max=100.0)
    bound = success_bound(scenario, 4_000_000, max_work=0)
    # the rim's point that is farthest from the radar, within reach
    angles = np.linspace(0, 2 * np.pi, 200_001)
    rim = np.array([0.9, 0.0]) + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inside = rim[(np.abs(rim) <= reach).all(axis=1)]
    corners = np.array([(reach, -math.sqrt(0.25 - (0.9 - reach) ** 2)), *inside])
    rates = np.array([single_agent_rate_by_hand(x, y, [radar]) for x, y in corners])
    point = corners[rates.argmin()]
    success = 1 - (1 - math.exp(-DT * FACTOR * rates.min())) ** 3
    assert success <= bound.value <= success + 1e-4
    paths = np.stack([np.zeros((3, 2)), np.tile(0.9 + (point - 0.9) * (1 - 1e-9), (3, 1))])
    paths[1] = point
    assert PlanDistribution.from_positions(scenario, paths).cost("success") >= bound.failure


def test_success_bound_ignores_members_out_of_reach() -> None:
    near = small([(0.0, 0.0)], (3.0, 0.0), [(1.4, 1.0)], 8)
    with_far = near.with_values({"swarm.positions": [(0.0, 0.0), (-50.0, 0.0)]})
    risks = success_bound(with_far, max_work=0).risks
    assert risks[1] == math.inf
    fraction = (1 + ALPHA[1]) / (1 + 2 * ALPHA[1])
    assert risks[0] == pytest.approx(fraction * success_bound(near, max_work=0).risks[0], rel=0.02)


def test_success_bound_is_monotone() -> None:
    scenario = load_scenario("paper-1")
    coarse, fine = (success_bound(scenario, nodes, max_work=0) for nodes in (100_000, 4_000_000))
    assert coarse.failure <= fine.failure <= 1.15 * coarse.failure
    stronger = scenario.with_values({"hazard.alpha_1": 5.0})
    assert success_bound(stronger).value < success_bound(scenario).value  # of either method
    longer = scenario.with_values({"time.t_f": 12.0})
    calm = success_bound(scenario, max_work=0)
    assert success_bound(longer, 4_000_000, max_work=0).value >= calm.value


def test_success_bound_is_sharper_with_collisions() -> None:
    scenarios = [load_scenario(name) for name in ("paper-1", "paper-2")]
    calm, crowded = (success_bound(scenario, max_work=0) for scenario in scenarios)
    assert crowded.failure > 10 * calm.failure


# --- the least rate


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=60, deadline=None)
def test_least_rate_is_below_rates_of_formations(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    radars = [tuple(map(float, rng.uniform(-3, 3, 2))) for _ in range(2)]
    for hazard in (
        Saturation(radars, None, 4.0, 3.0, 4.0),
        SaturationCollision(radars, None, 4.0, 3.0, 4.0, 0.2, float(rng.uniform(2, 8))),
    ):
        least = hazard.least_rate(n)
        assert least is not None
        width = 10.0 ** rng.uniform(-2, 0.5)
        positions = rng.uniform(-3, 3, 2) + width * rng.normal(size=(20, n, 2))
        alive = rng.random((20, n)) < 0.7
        rates, single = hazard.rates(positions, alive), hazard.single_agent_rates(positions)
        assert (rates[alive] >= least(single)[alive] * (1 - 1e-9)).all()


def test_least_rate_with_collisions_matches_best_spacing() -> None:
    """Two members: the least over their distance, by search."""
    hazard = SaturationCollision([(0.0, 0.0)], None, 4.0, 3.0, 4.0, 0.2, 6.0)
    least = hazard.least_rate(2)
    assert least is not None
    h = np.linspace(1e-6, 1 - 1e-9, 400_001)
    g = (0.04 / np.maximum((1 / h - 1) / 4.0, 1e-12)) ** 3
    for b in (0.1, 1.0, 10.0):
        exact = (b * 4.0 / (1 + 3.0 * (1 + h)) + g).min()
        assert exact * 0.999 <= least(np.array(b)) <= exact * (1 + 1e-9)


def test_least_rate_is_minimum_of_lines() -> None:
    rng = np.random.default_rng(0)
    lines = np.sort(rng.random(40)), np.sort(rng.random(40))[::-1]
    least = LeastRate(*lines)
    b = np.concatenate([[0.0], 10.0 ** rng.uniform(-3, 3, 200)])
    brute = (lines[0][:, None] + lines[1][:, None] * b).min(axis=0)
    np.testing.assert_allclose(least(b), brute, rtol=1e-12)


def test_least_rate_is_not_inherited() -> None:
    class Stronger(Saturation):
        pass

    assert Stronger([(0.0, 0.0)]).least_rate(3) is None


# --- reports


def test_success_bound_custom_hazard_reports_reason() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.0), [(1.4, 1.0)], 8)
    bound = success_bound(scenario.with_hazard(patrolled, radars=[(1.4, 1.0)]))
    assert not bound.certified
    assert float(bound) == 1.0
    assert "CustomHazard does not provide the least rate of a member among 1" in str(bound)


@pytest.mark.parametrize(
    ("failure", "shown"),
    [
        (4.1739e-6, "0.9999959"),
        (1.6e-4, "0.99984"),
        (0.04, "0.9600"),
        (0.5, "0.5001"),
        (3.17e-50, "1 - 3.1e-50"),
        (0.0, "1 - 0.0e+00"),
    ],
)
def test_success_bound_is_rounded_upward(failure: float, shown: str) -> None:
    bound = SuccessBound(failure, (1.0,))
    assert str(bound) == f"no policy can exceed {shown} (independent clocks)"
    assert float(bound) >= 1 - failure


def test_exponential_clocks_match_chain() -> None:
    """The proof's coupling: independent clocks give the chain's distribution of one step."""
    rates = np.array([0.3, 0.8])
    clocks = np.random.default_rng(0).exponential(size=(200_000, 2))
    counted = {
        outcome: ((clocks > rates) == outcome).all(axis=1).mean()
        for outcome in itertools.product((True, False), repeat=2)
    }
    for outcome, fraction in counted.items():
        exact = np.prod(np.where(outcome, np.exp(-rates), -np.expm1(-rates)))
        assert fraction == pytest.approx(exact, abs=5e-3)


# --- targets just within reach, members far out of it


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
