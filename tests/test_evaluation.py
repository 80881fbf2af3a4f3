"""Exact laws, against enumeration by hand, closed recursions and Monte Carlo."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.stats import binomtest

import casswarm as cs
from casswarm.errors import PolicyError
from casswarm.evaluation import evaluate
from casswarm.policies import motion_of

PAPER = cs.load_scenario("paper-1")
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

    def go(step, positions, previous, alive):  # noqa: ARG001
        return motion_of(scenario).toward(positions, previous, np.array(scenario.target.center))

    return go


@pytest.fixture(scope="module")
def guide():
    return cs.plan(PAPER)


def enumerated(scenario, before):
    """Success probability and law of survivors: every fate of every member, by recursion."""
    policy, dt, n = homing(scenario), scenario.time.dt, scenario.n
    survivors = np.zeros(n + 1)

    def go(step, positions, previous, alive, weight):
        if not any(alive) or step == scenario.n_steps:
            survivors[sum(alive)] += weight
            return 0.0
        mask = np.array(alive)
        shown = mask[:, None]
        velocities = policy(step, shown * positions, shown * previous, mask)
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


def test_two_members_have_the_law_of_enumeration_by_hand():
    given = SMALL.with_values({"swarm.velocity": [1.0, 0.0]})
    law = evaluate(given, homing(given), tolerance=0.0)
    success, survivors = enumerated(given, np.tile([1.0, 0.0], (2, 1)))
    assert 0.05 < success < 0.95
    assert law.unresolved == 0.0
    assert law.success == pytest.approx((success, success), rel=1e-12)
    np.testing.assert_allclose(law.survivors, survivors, rtol=1e-12, atol=1e-15)


def test_one_member_along_the_guide_has_the_guides_survival():
    scenario = cs.load_scenario("single-agent")
    guide = cs.plan(scenario)
    law = evaluate(scenario, "leader", tolerance=0.0, guide=guide)
    assert law.success == pytest.approx((guide.survival, guide.survival), rel=1e-12)
    assert law.arrival.argmax() == guide.arrival


def test_naive_has_the_law_of_the_recursion_over_alive_sets(guide):
    law = evaluate(PAPER, "naive", tolerance=0.0, guide=guide)
    policy = cs.make_policy("naive", PAPER, guide)
    n, dt = PAPER.n, PAPER.time.dt
    paths, previous = [PAPER.positions], np.tile(guide.velocities[0], (n, 1))
    for step in range(PAPER.n_steps):
        alive = np.ones((1, n), bool)
        previous = policy.velocities(step, paths[-1][None], previous[None], alive)[0]
        paths.append(paths[-1] + dt * previous)
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


@pytest.mark.parametrize("name", ["paper-1", "paper-2"])
@pytest.mark.parametrize("policy", ["naive", "leader", "constrained"])
def test_the_law_agrees_with_twenty_thousand_runs(name, policy):
    scenario = cs.load_scenario(name)
    guide = cs.plan(scenario)
    heavy = (name, policy) == ("paper-2", "constrained")  # a hundred times the states
    low, high = evaluate(
        scenario, policy, 1e-3, most_states=1_000 if heavy else 20_000, guide=guide
    ).success
    runs = 1_000 if heavy else 20_000
    row = cs.simulate(scenario, [policy], runs, seed=3, guide=guide).summary.iloc[0]
    interval = binomtest(int(row["successes"]), runs).proportion_ci(0.999, method="wilson")
    assert interval.low <= high
    assert low <= interval.high


def test_brackets_are_nested_as_the_tolerance_shrinks(guide):
    brackets = [
        evaluate(PAPER, "leader", tolerance, guide=guide).success
        for tolerance in (1e-1, 1e-2, 1e-3, 1e-4)
    ]
    for (low, high), (inner_low, inner_high) in pairwise(brackets):
        assert low <= inner_low <= inner_high <= high
    for tolerance, (low, high) in zip((1e-1, 1e-2, 1e-3, 1e-4), brackets, strict=True):
        assert high - low <= tolerance


def test_all_mass_is_accounted_for(guide):
    law = evaluate(PAPER, "leader", 1e-3, guide=guide)
    assert law.survivors.sum() + law.unresolved == pytest.approx(1.0, abs=1e-12)
    assert law.members.sum() == pytest.approx(law.survivors @ np.arange(6), rel=1e-12)
    assert law.arrival.sum() <= law.survivors[1:].sum() + 1e-12


def test_too_few_states_widen_the_bracket_around_the_truth(guide):
    narrow = evaluate(PAPER, "leader", 1e-3, guide=guide)
    wide = evaluate(PAPER, "leader", 1e-3, most_states=20, guide=guide)
    assert wide.unresolved > 1e-3
    assert wide.states <= 20 * PAPER.n_steps
    assert wide.success[0] <= narrow.success[0]
    assert narrow.success[1] <= wide.success[1]


def test_progress_is_told_step_by_step(guide):
    told = []
    evaluate(PAPER, "naive", guide=guide, progress=lambda step, states: told.append((step, states)))
    assert [step for step, _ in told] == list(range(1, len(told) + 1))
    assert told[0] == (1, 1)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"tolerance": 1.0}, ValueError, "tolerance"),
        ({"tolerance": -0.1}, ValueError, "tolerance"),
        ({"most_states": 0}, ValueError, "most_states"),
        ({"policy": "leeder"}, PolicyError, "did you mean 'leader'"),
    ],
)
def test_wrong_arguments_are_explained(guide, options, error, words):
    with pytest.raises(error, match=words):
        evaluate(PAPER, guide=guide, **options)


def test_a_swarm_too_large_is_refused_with_a_way_out():
    with pytest.raises(PolicyError, match=r"50 members.*use simulate"):
        evaluate(cs.load_scenario("large-swarm"))
