"""Swarms in a hazard that is not known: laws, runs, beliefs and bounds against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from small_scenarios import abreast, pair

import casswarm as csw
from casswarm.chain.belief import UNITS, Observation, rounded
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import ScenarioError

LEFT, RIGHT = {"radars": [[1.0, 0.9]], "weight": 3.0}, {"radars": [[1.0, -0.9], [2.0, 1.0]]}


def unknown(n: int = 3, steps: int = 8, **values: object) -> csw.Scenario:
    return abreast(n, steps, hazard__radars=None, hazard__case=[LEFT, RIGHT], **values)


TWO = unknown()
GUIDE = csw.plan(TWO.believed, certify=False)
POLICIES = "naive", "leader", "constrained", "constrained-feedback", "joint"


@pytest.mark.parametrize("name", POLICIES)
def test_law_of_the_prior_is_the_mean_of_the_laws_of_the_cases(name: str) -> None:
    policy = csw.make_policy(name, TWO, GUIDE)
    law = csw.evaluate(TWO, policy, 0.0, guide=GUIDE)
    known = [csw.evaluate(case.scenario, policy, 0.0, guide=GUIDE) for case in TWO.cases]
    assert [weight for weight, _ in law.cases] == [0.75, 0.25]
    for (_, ours), theirs in zip(law.cases, known, strict=True):
        np.testing.assert_array_equal(ours.arrival, theirs.arrival)
        np.testing.assert_array_equal(ours.population, theirs.population)
    mean = 0.75 * known[0].arrival + 0.25 * known[1].arrival
    np.testing.assert_allclose(law.arrival, mean, rtol=1e-14)
    assert law.success.low == pytest.approx(mean.sum(), rel=1e-14)


def test_equal_cases_and_weight_zero_change_nothing() -> None:
    first = TWO.cases[0].scenario
    same = unknown().with_values({"hazard.case": [LEFT, LEFT | {"weight": 1.0}]})
    own = csw.plan(first, certify=False)
    ours, theirs = (csw.evaluate(each, "leader", 0.0, guide=own) for each in (same, first))
    assert ours.success == theirs.success
    assert not ours.cases
    runs = [csw.simulate(each, "leader", 40, guide=own).runs for each in (same, first)]
    assert runs[0].equals(runs[1])
    zero = TWO.with_values({"hazard.case": [LEFT, RIGHT | {"weight": 0.0}]})
    law = csw.evaluate(zero, "leader", 0.0, guide=own)
    assert law.success.low == pytest.approx(theirs.success.low, abs=1e-15)
    assert (csw.simulate(zero, "leader", 40, guide=own).runs["case"] == 0).all()


@pytest.mark.parametrize("belief", ["prior", "bayes"])
def test_runs_agree_with_the_exact_law(belief: str) -> None:
    scenario = TWO.replace(formation={"belief": belief})
    law = csw.evaluate(scenario, "constrained", guide=GUIDE)
    study = csw.simulate(scenario, "constrained", 4000, 3, guide=GUIDE)
    row = study.summary.iloc[0]
    assert row["success_low"] <= law.success.high
    assert row["success_high"] >= law.success.low
    assert study.cases is not None
    by_case = study.cases.set_index("case")
    assert by_case.loc["0", "runs"] + by_case.loc["1", "runs"] == 4000
    assert abs(by_case.loc["0", "runs"] / 4000 - 0.75) < 0.03
    for k, (_, each) in enumerate(law.cases):
        assert by_case.loc[str(k), "success_low"] <= each.success.high + 0.01
        assert by_case.loc[str(k), "success_high"] >= each.success.low - 0.01


@pytest.mark.slow
def test_runs_do_not_depend_on_batches_or_workers() -> None:
    bayes = TWO.replace(formation={"belief": "bayes"})
    one = csw.simulate(bayes, ["leader", "constrained"], 60, guide=GUIDE)
    two = csw.simulate(bayes, ["leader", "constrained"], 60, workers=2, guide=GUIDE)
    assert one.runs.equals(two.runs)
    first = csw.simulate(bayes, "leader", 20, guide=GUIDE).runs
    head = one.runs[one.runs["policy"] == "leader"].head(20).reset_index(drop=True)
    assert first.equals(head)
    # the same case under every policy
    cases = one.runs.pivot(index="run", columns="policy", values="case")
    assert (cases["leader"] == cases["constrained"]).all()


def test_estimates_cover_the_law_of_the_prior() -> None:
    law = csw.evaluate(TWO, "constrained", 0.0, guide=GUIDE)
    found = csw.estimate(TWO, "constrained", 500, 1, guide=GUIDE, max_states=20)
    assert found.success.low <= law.success.low <= found.success.high
    assert len(found.cases) == 2
    assert found.enumerated.success.low <= found.success.low


def posterior(prior, survival, alive, survived):
    """Bayes' rule, one factor after another."""
    weights = []
    for weight, probabilities in zip(prior, survival, strict=True):
        product = weight
        for p, before, after in zip(probabilities, alive, survived, strict=True):
            if before:
                product *= p if after else 1.0 - p
        weights.append(product)
    return np.array(weights) / sum(weights)


def test_posterior_is_bayes_rule_up_to_its_memory() -> None:
    rng = np.random.default_rng(0)
    survival = rng.uniform(0.2, 1.0, (3, 4, 5))
    alive, prior = rng.random((4, 5)) < 0.8, rng.dirichlet(np.ones(3), 4)
    belief = rounded(prior)
    assert abs(belief / UNITS - prior).max() <= 1 / UNITS
    survived = alive & (rng.random((4, 5)) < 0.5)
    rows = np.array([2, 0, 3, 1])
    found = Observation(belief, alive, survival).posterior(rows, survived[rows])
    for row, ours in zip(rows, found, strict=True):
        exact = posterior(belief[row], survival[:, row], alive[row], survived[row])
        assert abs(ours / ours.sum() - exact).max() <= 2 / UNITS
    impossible = Observation(belief, alive, np.ones_like(survival))
    np.testing.assert_array_equal(
        impossible.posterior(np.array([0]), np.zeros((1, 5), bool)), rounded(belief[:1])
    )


def test_bayes_law_equals_a_walk_through_all_histories() -> None:
    scenario = unknown(2, 5).replace(formation={"belief": "bayes"})
    guide = csw.plan(scenario.believed, certify=False)
    policy = csw.make_policy("constrained", scenario, guide)
    law = csw.evaluate(scenario, policy, 0.0, guide=guide, aggregation_tol=0.0)
    rates = [case.scenario.hazard for case in scenario.cases]
    dt, arrived = scenario.time.dt, np.zeros(2)
    first = np.tile(guide.velocities[0], (2, 1))

    def walk(step, positions, velocities, alive, belief, masses):
        nonlocal arrived
        if step == scenario.n_steps or not alive.any():
            return
        given = policy.given(belief[None])
        v = given.velocities(step, positions, velocities, alive)
        x = positions + dt * v
        p = np.array([np.exp(-dt * hazard.rates(x, alive)) for hazard in rates])
        for outcome in itertools.product([True, False], repeat=2):
            survived = np.array(outcome) & alive
            if not np.array_equal(survived, np.array(outcome)):
                continue
            likelihood = np.where(alive, np.where(survived, p, 1 - p), 1.0).prod(axis=1)
            mass = masses * likelihood
            if (survived & scenario.target.contains(x)).any():
                arrived += mass
                continue
            after = rounded((belief * likelihood)[None])[0]
            kept = survived[:, None]
            walk(step + 1, np.where(kept, x, 0), np.where(kept, v, 0), survived, after, mass)

    prior = np.array([case.weight for case in scenario.cases])
    walk(0, scenario.positions, first, np.ones(2, bool), rounded(prior[None])[0], np.ones(2))
    found = [each.success.low for _, each in law.cases]
    np.testing.assert_allclose(found, arrived, rtol=1e-9)
    assert law.success.low == pytest.approx(prior @ arrived, rel=1e-9)


def test_belief_of_equal_weights_is_the_policy_of_the_prior() -> None:
    scenario = unknown().with_values({"hazard.case": [LEFT | {"weight": 1.0}, RIGHT]})
    bayes = scenario.replace(formation={"belief": "bayes"})
    ours, theirs = (csw.make_policy("constrained", each, GUIDE) for each in (bayes, scenario))
    state = scenario.positions[None], np.zeros((1, 3, 2)), np.ones((1, 3), bool)
    given = ours.given(np.array([[UNITS // 2, UNITS // 2]]))
    np.testing.assert_array_equal(given.velocities(0, *state), theirs.velocities(0, *state))
    np.testing.assert_array_equal(ours.velocities(0, *state), theirs.velocities(0, *state))
    other = ours.given(np.array([[1, UNITS]])).velocities(0, *state)
    assert abs(other - theirs.velocities(0, *state)).max() > 1e-3
    assert given.leaders(0, *state).tolist() == theirs.leaders(0, *state).tolist()


def test_order_of_cases_changes_nothing() -> None:
    turned = TWO.with_values({"hazard.case": [RIGHT, LEFT]})
    for belief in ("prior", "bayes"):
        ours, theirs = (
            csw.evaluate(one.replace(formation={"belief": belief}), "constrained", guide=GUIDE)
            for one in (TWO, turned)
        )
        assert ours.success.low == pytest.approx(theirs.success.low, abs=2e-3)
        assert ours.cases[0][1].success.low == pytest.approx(
            theirs.cases[1][1].success.low, abs=2e-3
        )
    bounds = [csw.success_bound(one, 20_000, max_work=1e5) for one in (TWO, turned)]
    assert bounds[0].value == pytest.approx(bounds[1].value, rel=1e-12)


def test_environments_run_as_simulations_do() -> None:
    policy = csw.make_policy("constrained", TWO, GUIDE)
    study = csw.simulate(TWO, policy, 50, 7, guide=GUIDE)
    env = SwarmVectorEnv(TWO, 50, guide=GUIDE, autoreset_mode="Disabled")
    _, infos = env.reset(seed=7)
    np.testing.assert_array_equal(infos["case"], study.runs["case"])
    success = np.zeros(50, bool)
    for step in range(TWO.n_steps):
        swarms = env.batch.swarms
        state = swarms.positions.copy(), swarms.velocities.copy(), swarms.alive.copy()
        _, rewards, ended, _, _ = env.step(policy.velocities(step, *state))
        success |= rewards > 0
        if ended.all():
            break
    np.testing.assert_array_equal(success, study.runs["success"])


def test_bound_is_the_least_mean_of_those_of_the_cases() -> None:
    options = {"max_nodes": 20_000, "max_work": 1e5}
    own = [csw.success_bound(case.scenario, **options).value for case in TWO.cases]
    assert csw.success_bound(TWO, **options).value == pytest.approx(np.dot([0.75, 0.25], own))
    worst = csw.success_bound(TWO, **options, ambiguity="worst")
    assert worst.value == pytest.approx(min(own), rel=1e-12)
    assert len(worst.cases) == 2
    law = csw.evaluate(TWO, "joint", 0.0, guide=GUIDE)
    assert law.success.high <= csw.success_bound(TWO, **options).value
    with pytest.raises(csw.PlanningError, match="ambiguity = 'best'"):
        csw.success_bound(TWO, ambiguity="best")


def test_gradient_of_the_prior_is_the_mean() -> None:
    import casadi as ca

    def homing(step, positions, previous_velocities, alive, parameters):
        del step, previous_velocities, alive
        return parameters[0] * (ca.repmat(ca.DM(TWO.target.center).T, 3, 1) - positions)

    policy = csw.ParametricPolicy(homing, [0.5], TWO)
    found = csw.success_gradient(TWO, policy, tolerance=0.0, guide=GUIDE)
    each = [
        csw.success_gradient(case.scenario, policy, tolerance=0.0, guide=GUIDE)
        for case in TWO.cases
    ]
    mean = 0.75 * each[0].gradient + 0.25 * each[1].gradient
    np.testing.assert_allclose(found.gradient, mean, rtol=1e-12)
    assert found.states == each[0].states + each[1].states


def test_sweeps_and_rows_of_cases() -> None:
    table = csw.sweep(TWO, {"formation.belief": ["prior", "bayes"]}, "constrained").table
    assert (table["status"] == "ok").all()
    law = csw.evaluate(TWO, "constrained", guide=GUIDE)
    assert table["success_low"][0] == pytest.approx(law.success.low, abs=1e-3)


def test_what_beliefs_do_not_treat_is_refused_by_name() -> None:
    late = TWO.replace(formation={"belief": "bayes"}, information={"delay": 1})
    with pytest.raises(ScenarioError, match=r"formation.belief = 'bayes' treats only") as caught:
        csw.simulate(late, "leader", 5)
    assert caught.value.key == "information.delay"
    with pytest.raises(ScenarioError, match="2 cases"):
        csw.make_policy("optimal", pair(hazard__radars=None, hazard__case=[LEFT, RIGHT]))


@pytest.mark.parametrize("belief", ["prior", "bayes"])
def test_cases_of_other_constants_have_a_computed_mean(belief: str) -> None:
    other = unknown(2, 6).with_values({"hazard.case": [LEFT, RIGHT | {"alpha_3": 2.0}]})
    other = other.replace(formation={"belief": belief})
    guide = csw.plan(other.believed, certify=False)
    law = csw.evaluate(other, "constrained", 0.05, guide=guide)
    row = csw.simulate(other, "constrained", 300, guide=guide).summary.iloc[0]
    assert row["success_low"] <= law.success.high
    assert row["success_high"] >= law.success.low
