"""Exact distributions, against enumeration by hand, closed recursions and Monte Carlo."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.stats import binom, binomtest
from sweep_cases import SMALL as THREE

import casswarm as csw
from casswarm.chain import Chain, ExpansionOptions, StateSpaceExpansion, sample_residual
from casswarm.chain.confidence import clopper_pearson
from casswarm.chain.exact import _next_threshold
from casswarm.motion import Motion
from casswarm.policies import POLICIES, as_policy
from casswarm.studies import PAPER_POLICIES, evaluate

PAPER = csw.load_scenario("paper-1")
SMALL = PAPER.with_values(
    {
        "swarm.positions": [[0.0, 0.0], [0.5, 0.0]],
        "time.t_f": 1.4,
        "target.center": [2.0, 0.5],
        "hazard.alpha_1": 60.0,
    }
)


def homing(scenario):
    """Everybody toward the target as fast as the limits allow: no guide, no solver."""

    def go(step, positions, previous_velocities, alive):  # noqa: ARG001
        return Motion.from_scenario(scenario).toward(
            positions, previous_velocities, np.array(scenario.target.center)
        )

    return go


@pytest.fixture(scope="module")
def guide():
    return csw.plan(PAPER)


def enumerated(scenario, before):
    """Success probability and law of survivors: every fate of every member, by recursion."""
    policy, dt, n = homing(scenario), scenario.time.dt, scenario.n
    survivors = np.zeros(n + 1)

    def go(step, positions, previous_velocities, alive, weight):
        if not any(alive) or step == scenario.n_steps:
            survivors[sum(alive)] += weight
            return 0.0
        mask = np.array(alive)
        shown = mask[:, None]
        velocities = policy(step, shown * positions, shown * previous_velocities, mask)
        following = positions + dt * shown * velocities
        rates = scenario.hazard.rates(following, mask)
        success = 0.0
        for fate in product((False, True), repeat=n):
            if any(f and not a for f, a in zip(fate, alive, strict=True)):
                continue
            factors = [
                (np.exp(-dt * rate) if f else 1 - np.exp(-dt * rate)) if a else 1.0
                for f, a, rate in zip(fate, alive, rates, strict=True)
            ]
            mass = weight * np.prod(factors)
            inside = scenario.target.contains(following)
            if any(f and i for f, i in zip(fate, inside, strict=True)):
                survivors[sum(fate)] += mass
                success += mass
            else:
                success += go(step + 1, following, velocities, fate, mass)
        return success

    return go(0, scenario.positions, before, (True,) * n, 1.0), survivors


def test_evaluate_two_members_equals_enumeration_by_hand():
    given = SMALL.with_values({"swarm.velocity": [1.0, 0.0]})
    law = evaluate(given, homing(given), tolerance=0.0)
    success, survivors = enumerated(given, np.tile([1.0, 0.0], (2, 1)))
    assert 0.05 < success < 0.95
    assert law.residual_mass == 0.0
    assert law.success == pytest.approx((success, success), rel=1e-12)
    np.testing.assert_allclose(law.survivors, survivors, rtol=1e-12, atol=1e-15)


def test_evaluate_single_agent_equals_guide_survival():
    scenario = csw.load_scenario("single-agent")
    guide = csw.plan(scenario)
    law = evaluate(scenario, "leader", tolerance=0.0, guide=guide)
    assert law.success == pytest.approx((guide.survival, guide.survival), rel=1e-12)
    assert law.arrival.argmax() == guide.arrival


def test_evaluate_naive_equals_recursion_over_alive_sets(guide):
    law = evaluate(PAPER, "naive", tolerance=0.0, guide=guide)
    policy = csw.make_policy("naive", PAPER, guide)
    n, dt = PAPER.n, PAPER.time.dt
    paths, previous_velocities = [PAPER.positions], np.tile(guide.velocities[0], (n, 1))
    for step in range(PAPER.n_steps):
        alive = np.ones((1, n), bool)
        previous_velocities = policy.velocities(
            step, paths[-1][None], previous_velocities[None], alive
        )[0]
        paths.append(paths[-1] + dt * previous_velocities)
    sets = [np.array(alive) for alive in product((False, True), repeat=n)]
    value = {tuple(alive): 0.0 for alive in sets}  # probability of success from here on
    for positions in reversed(paths[1:]):
        inside, following = PAPER.target.contains(positions), value
        value = {}
        for alive in sets:
            survival = np.exp(-dt * PAPER.hazard.rates(positions, alive))
            value[tuple(alive)] = sum(
                np.prod(np.where(alive, np.where(fate, survival, 1 - survival), 1.0))
                * (1.0 if (fate & inside).any() else following[tuple(fate)])
                for fate in sets
                if not (fate & ~alive).any()
            )
    assert law.success == pytest.approx((value[(True,) * n],) * 2, rel=1e-9)


def test_evaluate_bounds_are_nested_for_smaller_tolerance(guide):
    bounds = [
        evaluate(PAPER, "leader", tolerance, guide=guide).success
        for tolerance in (1e-1, 1e-2, 1e-3, 1e-4)
    ]
    for (low, high), (inner_low, inner_high) in pairwise(bounds):
        assert low <= inner_low <= inner_high <= high
    for tolerance, (low, high) in zip((1e-1, 1e-2, 1e-3, 1e-4), bounds, strict=True):
        assert high - low <= tolerance


def test_evaluate_probabilities_sum_to_one(guide):
    law = evaluate(PAPER, "leader", 1e-3, guide=guide)
    assert law.survivors.sum() + law.residual_mass == pytest.approx(1.0, abs=1e-12)
    assert law.members.sum() == pytest.approx(law.survivors @ np.arange(6), rel=1e-12)
    assert law.arrival.sum() <= law.survivors[1:].sum() + 1e-12


def test_evaluate_with_few_states_has_wider_bounds(guide):
    narrow = evaluate(PAPER, "leader", 1e-3, guide=guide)
    wide = evaluate(PAPER, "leader", 1e-3, max_states=20, guide=guide)
    assert wide.residual_mass > 1e-3
    assert wide.states <= 20
    assert "allow more states" in wide.advice
    assert not narrow.advice
    assert wide.success[0] <= narrow.success[0]
    assert narrow.success[1] <= wide.success[1]
    (low, high), (inner_low, inner_high) = wide.population_mean, narrow.population_mean
    assert (low <= inner_low + 1e-12).all()
    assert (inner_high <= high + 1e-12).all()
    arrived, inner = wide.arrival.cumsum(), narrow.arrival.cumsum()
    assert (arrived <= inner + 1e-12).all()
    assert (
        inner + narrow.residual_mass_before <= arrived + wide.residual_mass_before + 1e-12
    ).all()


def test_evaluate_progress_reports_enumerated_mass(guide):
    reports = []
    law = evaluate(PAPER, "leader", 1e-3, guide=guide, progress=lambda *args: reports.append(args))
    tasks, done, totals = zip(*reports, strict=True)
    assert set(tasks) == {"leader"}
    assert set(totals) == {1.0}
    assert done[0] == pytest.approx(0.0)
    assert all(after >= before - 1e-12 for before, after in pairwise(done))
    assert 1.0 - done[-1] == pytest.approx(law.residual_mass, rel=1e-9)


def test_estimate_progress_reports_enumerated_mass_and_then_runs(guide):
    reports = []
    csw.estimate(
        PAPER, "leader", 50, max_states=3, guide=guide, progress=lambda *r: reports.append(r)
    )
    tasks, sampled = [task for task, *_ in reports], [r for r in reports if r[0] == "sampling"]
    assert tasks == sorted(tasks)  # leader, then sampling
    assert [ended for _, ended, _ in sampled] == sorted(ended for _, ended, _ in sampled)
    assert sampled[-1] == ("sampling", 50, 50)


def test_evaluate_population_agrees_with_runs(guide):
    law = evaluate(PAPER, "leader", 1e-4, guide=guide)
    np.testing.assert_allclose(
        law.population.sum(axis=1) + law.residual_mass_before, 1.0, atol=1e-12
    )
    np.testing.assert_allclose(law.population[-1], law.survivors, atol=law.residual_mass)
    runs = 2000
    traces = csw.simulate(
        PAPER, ["leader"], runs, guide=guide, save_trajectories=runs
    ).trajectories["leader"]
    for step in (5, 12, 18):
        alive = [int(trace.alive[min(step, len(trace.alive) - 1)].sum()) for trace in traces]
        for k, count in enumerate(np.bincount(alive, minlength=6)):
            interval = binomtest(int(count), runs).proportion_ci(0.9999, method="exact")
            low = law.population[step, k]
            assert interval.low <= low + law.residual_mass_before[step]
            assert low <= interval.high


@pytest.mark.parametrize("policy", ["leader", pytest.param("constrained", marks=pytest.mark.slow)])
def test_evaluate_aggregation_stays_within_bounds(guide, policy):
    exact = evaluate(PAPER, policy, 3e-3, guide=guide, aggregation_tol=0.0)
    assert "rounded" not in str(exact)
    for aggregation_tol in (1e-8, 1e-6):
        law = evaluate(PAPER, policy, 3e-3, guide=guide, aggregation_tol=aggregation_tol)
        assert f"motion rounded to {aggregation_tol:.2g}" in str(law)
        assert law.states < exact.states
        assert max(law.success[0], exact.success[0]) <= min(law.success[1], exact.success[1])


def test_expansion_counts_pruned_mass():
    """Thirteen members have 8192 outcomes a step, which are not all followed."""
    ring = 0.3 * np.stack([np.cos(np.arange(13)), np.sin(np.arange(13))], axis=1)
    given = SMALL.with_values({"swarm.positions": ring.tolist(), "hazard.alpha_1": 1.0})
    law = evaluate(given, homing(given), 1e-2)
    assert 0.0 < law.residual_mass <= 1e-2
    assert law.survivors.sum() + law.residual_mass == pytest.approx(1.0, abs=1e-9)
    row = csw.simulate(given, [homing(given)], 2000).summary.iloc[0]
    interval = binomtest(int(row["successes"]), 2000).proportion_ci(0.999, method="wilson")
    assert interval.low <= law.success[1]
    assert law.success[0] <= interval.high


# --- the head exactly, the rest sampled


def test_estimate_contains_exact_value(guide):
    truth = evaluate(PAPER, "leader", 1e-4, guide=guide).success
    found = csw.estimate(PAPER, "leader", 2000, max_states=300, guide=guide)
    low, high = found.success
    first, last = found.enumerated.success
    assert first <= low <= truth[0] <= truth[1] <= high <= last
    assert f"{found.sampled_mass:.4g} sampled" in str(found)
    assert "95% confidence; proven" in str(found)
    assert csw.estimate(PAPER, "leader", 2000, max_states=300, guide=guide).success == (low, high)


@pytest.mark.slow
@pytest.mark.parametrize("runs", [60, 100])
def test_estimate_covers_exact_value_at_its_level(runs):
    given = SMALL.with_values({"swarm.velocity": [1.0, 0.0]})
    policy, before = as_policy(homing(given)), np.tile([1.0, 0.0], (2, 1))
    truth = evaluate(given, policy, 0.0).success[0]
    expansion = StateSpaceExpansion(given, policy, before, ExpansionOptions(1e-4, max_states=4))
    expansion.expand()
    assert expansion.frontier.mass > 0.2
    chains = [Chain(given, before, seed) for seed in range(1000)]
    found = [sample_residual(expansion, chain, runs).success for chain in chains]
    covered = sum(low <= truth <= high for low, high in found)
    assert covered >= binom(1000, 0.95).ppf(0.001)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper-1", "paper-2"])
@pytest.mark.parametrize("policy", ["leader", "constrained"])
def test_estimate_is_narrower_than_plain_sampling(name, policy):
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario, certify=False)
    found = csw.estimate(scenario, policy, 2000, tolerance=1e-4, guide=guide)
    runs, solved = 2000, 0
    while solved < found.states:  # distinct ones: plain runs meet equal states too
        plain = csw.simulate(scenario, [policy], runs, guide=guide, save_trajectories=0)
        solved = plain.effort["states"][0]
        runs = math.ceil(runs * max(1.05, found.states / solved))
    row = plain.summary.iloc[0]
    assert found.success[1] - found.success[0] < row.success_high - row.success_low


def test_estimate_without_enumeration_is_plain_sampling():
    scenario = csw.load_scenario("large-swarm")
    found = csw.estimate(scenario, homing(scenario), 50)
    row = csw.simulate(scenario, [homing(scenario)], 50).summary.iloc[0]
    assert found.sampled_mass == 1.0
    assert found.successes == row.successes
    assert found.success == pytest.approx(clopper_pearson(row.successes, 50))


def test_estimate_handles_fifty_members():
    scenario = csw.load_scenario("large-swarm")
    found = csw.estimate(scenario, homing(scenario), 50, max_states=20)
    low, high = found.success
    assert 0.0 <= low < high <= 1.0
    assert found.runs == 50


def test_estimate_without_residual_mass_samples_nothing():
    given = SMALL.with_values({"swarm.velocity": [1.0, 0.0]})
    found = csw.estimate(given, homing(given), 10, tolerance=0.0, max_states=1000)
    assert found.runs == 0
    assert found.success == found.enumerated.success


def test_evaluate_accepts_list_of_one_policy(guide):
    single = evaluate(PAPER, "leader", 0.1, guide=guide)
    assert evaluate(PAPER, ["leader"], 0.1, guide=guide).success == single.success


def test_evaluate_ends_when_all_states_are_expanded() -> None:
    """Budgets and tolerances around the place where every state has been followed."""
    pair = THREE.with_values({"swarm.positions": [[0.0, 0.0], [0.5, 0.0]]})
    for max_states in (20, 60, 200, 600):
        law = csw.evaluate(pair, "leader", 1e-7, max_states=max_states)
        low, high = law.success
        assert low <= high
    assert law.complete
    assert _next_threshold([(1e-2, 0.1, 10), (1e-3, 0.01, 30)], 1e-4, 1000) < 1e-3


# --- every policy, against twenty thousand runs

ANY_SIZE = [policy for policy in POLICIES if policy != "optimal"]  # which is for two members
PAIRS = [("paper-1", policy) for policy in ANY_SIZE]
PAIRS += [("paper-2", policy) for policy in ANY_SIZE if "mpc" not in policy]  # beyond any budget
WIDE = {
    ("paper-2", "constrained"),
    ("paper-1", "constrained-mpc-3"),
    ("paper-2", "leader-feedback"),  # complete with 990,000 states
}
"""Distributions that need more states than a test has time for; their bounds hold anyway."""


def limits(name, policy):
    """Tolerance, states and lattice of a distribution."""
    if (name, policy) == ("paper-2", "leader"):  # every history has other places: 2.1 million
        return 1e-3, 2_500_000, 1e-5
    return (1e-3, 700_000, None) if policy in PAPER_POLICIES else (0.03, 150_000, None)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "policy"), PAIRS)
def test_evaluate_agrees_with_twenty_thousand_runs(name, policy):
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario)
    tolerance, most, aggregation_tol = limits(name, policy)
    made = csw.make_policy(policy, scenario, guide)  # one, so that joint plans are made once
    law = evaluate(
        scenario,
        made,
        tolerance,
        max_states=most,
        aggregation_tol=aggregation_tol,
        guide=guide,
    )
    assert law.complete or (name, policy) in WIDE
    (low, high), runs = law.success, 20_000
    assert high - low < 0.1
    row = csw.simulate(scenario, [made], runs, seed=3, guide=guide).summary.iloc[0]
    interval = binomtest(int(row["successes"]), runs).proportion_ci(0.999, method="wilson")
    assert interval.low <= high
    assert low <= interval.high
