"""Bounds of a swarm's success: no random or improved plan, and no policy, exceeds one."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from random_plans import best_success, some_scenario
from small_scenarios import small

from casswarm import evaluate, load_scenario, plan, plan_swarm, success_bound
from casswarm.bounds import pair_bound
from casswarm.policies import JointPolicy


@pytest.mark.parametrize("collides", [False, True])
@pytest.mark.parametrize("n", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3, 4))])
def test_success_bound_exceeds_random_plans(n, collides):
    rng, near = np.random.default_rng([n, collides]), 0
    for _ in range(40):
        scenario = some_scenario(rng, n, int(rng.integers(1, 7)), collides)
        bound = success_bound(scenario, 20_000, max_work=1e4)
        assert bound.certified
        largest = best_success(scenario, rng, 6).high
        assert largest <= bound.value
        near += largest > bound.value - 0.1
    assert near > 0  # the bound is not just 1


@pytest.mark.parametrize("collides", [False, True])
def test_pair_bound_exceeds_random_plans_with_and_without_a_known_one(collides):
    rng, near = np.random.default_rng([7, collides]), 0
    for _ in range(10):
        scenario = some_scenario(rng, 2, int(rng.integers(1, 6)), collides)
        known = best_success(scenario, rng, 8)
        for share in (0.0, 0.5, 1 - 1e-12):
            bound = pair_bound(scenario, known.low * share, max_nodes=150_000)
            assert known.high <= bound.value <= 1.0
        near += bound.value < known.low + 0.1
    assert near > 0


@pytest.mark.parametrize(
    ("seed", "trials"),
    [
        *((seed, 30) for seed in range(4)),
        *(pytest.param(seed, 150, marks=pytest.mark.slow) for seed in range(4, 100)),
    ],
)
def test_no_climbed_plan_exceeds_the_bound(seed, trials):
    rng = np.random.default_rng(seed)
    scenario = some_scenario(rng, int(rng.integers(2, 5)), int(rng.integers(1, 9)), seed % 3 == 0)
    factor = float(rng.choice([0.5, 1, 2, 4, 8]))
    scenario = scenario.with_values({"hazard.alpha_1": factor * scenario.hazard.alpha_1})
    bound = success_bound(scenario, 20_000, max_work=float(rng.choice([1e5, 1e6])), accuracy=0.0)
    assert best_success(scenario, rng, 2, trials).low <= bound.value


@pytest.mark.parametrize("seed", range(4))
def test_success_bound_exceeds_policies(seed):
    rng = np.random.default_rng(seed)
    scenario = some_scenario(rng, 1 + seed % 3, 6, seed % 2 == 1)
    bound = success_bound(scenario, 50_000, max_work=1e6)
    guide = plan(scenario, certify=False, search="global")
    best = plan_swarm(scenario, guide=guide, initial_guesses=["formations"])
    assert best.success.high <= bound.value
    for policy in (
        "naive",
        "constrained",
        "leader",
        "leader-feedback",
        JointPolicy.from_plan(best),
    ):
        distribution = evaluate(scenario, policy, 1e-3, guide=guide)
        assert distribution.success.low <= bound.value


@pytest.mark.parametrize("name", ["paper-1", "paper-2", "gauntlet"])
def test_success_bound_exceeds_leader_on_paper_scenarios(name):
    scenario = load_scenario(name)
    bound = float(success_bound(scenario))
    leader = evaluate(scenario, "leader", 1e-2, max_states=20_000)  # a lower end suffices
    assert leader.success.low < bound < 1.0


ALLEY, PAPER = load_scenario("alley"), load_scenario("paper-1")
PAIR = small([(0.0, 0.0), (0.2, 0.3)], (2.0, 0.4), [(1.3, 0.7), (2.1, -0.9)], 4)


@pytest.mark.parametrize(
    ("scenario", "bound", "strengths"),
    [
        (PAPER, success_bound, (4.0, 5.0)),
        (ALLEY, partial(success_bound, max_nodes=100_000, max_work=3e6), (2, 3, 4)),
        (PAIR, partial(pair_bound, max_nodes=300_000), (1, 4, 16)),
    ],
)
def test_bound_falls_with_rates(scenario, bound, strengths):
    values = [bound(scenario.with_values({"hazard.alpha_1": s})).value for s in strengths]
    assert (np.diff(values) < 0).all()
    assert values[-1] > 0
