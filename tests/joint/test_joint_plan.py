"""The joint plan: its probability against brute force, evaluate and sampling, and its search."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from small_scenarios import BESIDE, abreast, rate_by_hand, small

from casswarm import (
    SolverError,
    evaluate,
    load_scenario,
    make_policy,
    plan,
    plan_swarm,
)
from casswarm.errors import PlanningError, PolicyError
from casswarm.guide import initial_velocities
from casswarm.joint import PlanDistribution, search
from casswarm.policies import JointPolicy
from casswarm.problems import JointForm, JointTask, joint_instances, joint_nlp

TRIO = abreast(3)


@pytest.fixture(scope="module")
def best():
    return plan_swarm(TRIO)


def by_hand(scenario, positions, objective):
    """Expected value of a run of the plan, outcome by outcome."""
    dt, n = scenario.time.dt, scenario.n

    def value(step, alive):
        if not any(alive) or step == len(positions) - 1:
            return 0.0 if objective != "survivors" else float(sum(alive))
        following = positions[step + 1]
        total = 0.0
        for outcome in itertools.product((True, False), repeat=n):
            if any(f and not a for f, a in zip(outcome, alive, strict=True)):
                continue
            p = 1.0
            for i in range(n):
                if alive[i]:
                    s = math.exp(-dt * rate_by_hand(i, following, alive, BESIDE))
                    p *= s if outcome[i] else 1 - s
            here = [
                outcome[i] and math.dist(following[i], scenario.target.center) <= 0.5
                for i in range(n)
            ]
            if any(here):
                ends = {"success": 1.0, "arrivals": sum(here), "survivors": sum(outcome)}
                total += p * float(ends[objective])
            else:
                total += p * value(step + 1, outcome)
        return total

    return value(0, (True,) * n)


# --- distribution


@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_plan_distribution_random_paths_match_brute_force(objective: str):
    scenario = TRIO
    rng = np.random.default_rng(7)
    paths = np.cumsum(np.vstack([np.zeros((1, 3, 2)), rng.normal(0.3, 0.3, (6, 3, 2))]), axis=0)
    positions = scenario.positions + paths
    distribution = PlanDistribution.from_positions(scenario, positions)
    plans = (1 - distribution.cost(objective)) * (1 if objective == "success" else 3)
    assert plans == pytest.approx(by_hand(scenario, positions, objective), abs=1e-12)


@pytest.mark.slow
def test_swarm_plan_success_matches_evaluate(best):
    scenario = TRIO
    distribution = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert distribution.residual_mass == 0
    low, high = best.success
    assert low <= distribution.success[0] <= high
    assert high - low < 1e-10
    assert best.distribution.survivors_mean == pytest.approx(
        distribution.survivors_mean[0], abs=1e-12
    )
    np.testing.assert_allclose(
        best.distribution.arrival, distribution.arrival[: best.steps + 1], atol=1e-14
    )
    np.testing.assert_allclose(best.distribution.survival[-1], distribution.members, atol=1e-13)


def test_plan_distribution_conserves_mass(best):
    distribution = best.distribution
    total = distribution.arrival.cumsum() + distribution.masses.sum(axis=1)
    np.testing.assert_allclose(total, 1.0, atol=1e-13)


def test_joint_policy_by_name_follows_plan(best):
    scenario = TRIO
    policy = make_policy("joint", scenario)
    states = scenario.positions[None], best.initial_velocities[None], np.ones((1, 3), bool)
    np.testing.assert_array_equal(policy.velocities(0, *states)[0], best.velocities[0])
    moved = states[0] + 0.01  # towards the next position, as near as the limits allow
    back = policy.decide(0, moved, states[1], states[2]).velocities
    missing = moved + best.motion.dt * back - best.positions[1]
    assert np.hypot(missing[..., 0], missing[..., 1]).max() <= 0.01 * math.sqrt(2) + 1e-9
    assert not best.motion.sets(states[1]).violation(back).max() > 1e-9
    assert pickle.loads(pickle.dumps(policy)).name == "joint"
    with pytest.raises(PolicyError, match="is for 3 members, the swarm has 2"):
        policy.velocities(0, np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), np.ones((1, 2), bool))


# --- the program


def posed(form, initial_velocities, arrivals, velocities):
    """The program of members abreast, and the variables and parameters of one instance."""
    scenario = abreast(form.n)
    nlp = joint_nlp(scenario.hazard, form)
    task = JointTask.from_scenario(scenario, initial_velocities)
    instance = joint_instances(nlp, form, task, [np.array(arrivals)], [velocities])
    return nlp, instance.x0[0], instance.p[0]


@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_joint_nlp_objective_is_log_odds_of_cost(objective: str):
    """With the paths' own arrival steps, the program computes the chain's cost."""
    scenario = abreast(2)
    guide = plan(scenario, certify=False)
    straight = np.array([(2.85, 0.2), (2.45, 0.1)]) / (8 * scenario.time.dt)
    velocities = np.tile(straight, (8, 1, 1))
    positions = np.stack([scenario.positions + scenario.time.dt * t * straight for t in range(9)])
    first = scenario.target.contains(positions[1:]).argmax(axis=0) + 1
    assert (first > 1).all()
    form = JointForm(2, scenario.n_steps, True, objective)
    before = initial_velocities(scenario, guide)
    nlp, x, p = posed(form, before, first, velocities[: first.max()])
    odds = float(nlp.evaluate(x, p)[0])
    cost = PlanDistribution.from_positions(scenario, positions[: first.max() + 1]).cost(objective)
    assert odds == pytest.approx(math.log(cost / (1 - cost)), rel=1e-9)


def test_joint_nlp_gradient_matches_finite_differences():
    velocities = np.random.default_rng(1).normal(1.2, 0.4, (8, 2, 2))
    for exact in (True, False):
        nlp, x, p = posed(JointForm(2, 8, exact), np.zeros((2, 2)), [8, 7], velocities)
        gradient = np.asarray(nlp.gradient(x, p)[1]).ravel()
        for row in range(0, len(x), 3):
            shift = 1e-6 * np.eye(len(x))[row]
            slope = float(nlp.evaluate(x + shift, p)[0] - nlp.evaluate(x - shift, p)[0]) / 2e-6
            assert slope == pytest.approx(float(gradient[row]), rel=1e-5, abs=1e-7)


def test_mean_field_single_member_is_exact():
    paths = np.random.default_rng(2).normal(1.2, 0.3, (8, 1, 2))
    odds = []
    for exact in (True, False):
        nlp, x, p = posed(JointForm(1, 8, exact), np.zeros((1, 2)), [8], paths)
        odds.append(float(nlp.evaluate(x, p)[0]))
    assert odds[0] == pytest.approx(odds[1], rel=1e-9)


# --- the search


def test_swarm_plan_satisfies_limits(best):
    scenario = TRIO
    assert np.abs(best.velocities).max() <= scenario.swarm.v_max
    change = np.diff(np.concatenate([best.initial_velocities[None], best.velocities]), axis=0)
    assert (change**2).sum(axis=-1).max() <= scenario.swarm.a_max * (1 + 1e-9)
    assert scenario.target.contains(best.positions[best.arrivals, np.arange(3)]).all()
    assert best.arrivals.max() == best.steps


def test_plan_swarm_single_member_matches_guide():
    scenario = abreast(1, 10, swarm__velocity=(1.0, 0.0))
    guide = plan(scenario, search="global", certify=False)
    best = plan_swarm(scenario)
    assert best.success[1] >= guide.survival - 1e-6
    rates = scenario.hazard.single_agent_rates(best.positions[1 : best.arrivals[0] + 1, 0])
    risk = scenario.time.dt * rates.sum()
    assert best.value == pytest.approx(math.exp(-risk), abs=1e-12)


def test_plan_swarm_own_guides_of_single_member_are_formations():
    best = plan_swarm(abreast(1), initial_guesses=["own"])
    assert {outcome.start.split()[0] for outcome in best.outcomes} == {"formation"}


@pytest.mark.slow
def test_plan_swarm_beats_paper_policies():
    scenario = abreast(2)
    best = plan_swarm(scenario)
    for name in ("naive", "leader"):
        assert best.success[0] >= evaluate(scenario, name, 1e-2).success[1] - 1e-2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least", "seeds"), [("paper-1", 0.999, (0, 5)), ("paper-2", 0.99, (1,))]
)
def test_plan_swarm_paper_scenarios_succeed_for_all_seeds(name, least, seeds):
    scenario = load_scenario(name)
    plans = [
        plan_swarm(scenario, seed=s, initial_guesses=["formations", "perturbed"]) for s in seeds
    ]
    for best in plans:
        assert best.success[0] > least
        assert best.success[1] <= float(best.bound)
    assert abs(plans[0].value - plans[-1].value) < 1e-3


@cache
def in_formations(objective="success", **options):
    return plan_swarm(abreast(2), objective, initial_guesses=["formations"], **options)


def test_plan_swarm_min_distance_is_kept():
    close, separated = in_formations(), in_formations(min_distance=0.3)
    assert close.least_distance < 0.1
    assert separated.least_distance >= 0.3 - 1e-5
    assert separated.value < close.value


def test_outcomes_of_members_too_close_have_no_value_in_tables():
    kept = in_formations(min_distance=0.3).outcomes[0]
    close = replace(kept, separated=False)
    assert kept.as_row()["value"] == kept.value
    assert math.isnan(close.as_row()["value"])
    assert math.isfinite(close.value)


def test_plan_swarm_large_min_distance_arrives_one_by_one():
    positions = [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)]
    scenario = small(positions, (3.0, 0.2), BESIDE, 6)
    best = plan_swarm(scenario, initial_guesses=["formations"], min_distance=0.95)
    assert best.least_distance >= 0.949
    assert len(set(best.arrivals.tolist())) == 3
    assert "COME WITHIN" not in str(best)
    assert "COME WITHIN 0.95" in str(replace(best, min_distance=2.0))


@pytest.mark.slow
def test_plan_swarm_arrivals_are_simultaneous():
    success, arriving, surviving = map(in_formations, ("success", "arrivals", "survivors"))
    assert len(set(arriving.arrivals.tolist())) == 1
    assert arriving.value == pytest.approx(arriving.distribution.arrivals_mean, abs=1e-12)
    assert surviving.value == pytest.approx(surviving.distribution.survivors_mean)
    assert arriving.value >= success.distribution.arrivals_mean - 1e-6
    assert surviving.value >= success.distribution.survivors_mean - 1e-6


def test_plan_swarm_unreachable_target_is_not_prescribed():
    scenario = small([(0.0, 0.0), (-9.0, 0.0)], (3.0, 0.2), BESIDE, 8)
    best = plan_swarm(scenario, initial_guesses=["formations"])
    assert best.arrivals[0] > 0
    assert best.arrivals[1] == 0
    assert "1 of 2 members DO NOT ARRIVE" in str(best)
    distribution = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert best.success[0] <= distribution.success[0] <= best.success[1]


def gentle(positions: ca.MX, alive: ca.MX, radars: tuple[tuple[float, float], ...]) -> ca.MX:
    """Rates that are not kernels, which all living members share."""
    (x, y) = radars[0]
    away = (positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2
    return 1.0 / (0.2 + away) / ca.fmax(ca.sum1(alive), 1.0)


def test_plan_swarm_custom_hazard_matches_evaluate():
    scenario = abreast(2).with_hazard(gentle, radars=[(1.5, 0.0)])
    best = plan_swarm(scenario, initial_guesses=["formations"])
    distribution = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert best.success[0] <= distribution.success[0] <= best.success[1]
    assert not best.bound.certified
    assert best.success.low > 0.1
    assert "CustomHazard does not provide" in str(best)


# --- wrong input


@pytest.mark.parametrize(
    ("error", "wrong", "message"),
    [
        (SolverError, {"objective": "sucess"}, "did you mean 'success'"),
        (SolverError, {"initial_guesses": ["formation"]}, "did you mean 'formations'"),
        (SolverError, {"initial_guesses": "own"}, "expected a list of"),
        (SolverError, {"solver": "ipoptt"}, "ipopt"),
        (ValueError, {"min_distance": 0.0}, "above 0"),
        (ValueError, {"min_distance": 0.6}, "members start 0.412311 apart; choose a smaller dist"),
        (ValueError, {"time_limit": 0.0}, "seconds above 0"),
    ],
)
def test_plan_swarm_with_invalid_argument_raises(error, wrong, message):
    with pytest.raises(error, match=message):
        plan_swarm(abreast(2), **wrong)


def test_plan_of_many_members_warns_and_of_more_is_refused(monkeypatch, caplog):
    def stop(*_, **__):
        raise InterruptedError

    monkeypatch.setattr(search, "plan", stop)
    circle = [[math.cos(k), math.sin(k)] for k in range(201)]
    with pytest.raises(InterruptedError):
        plan_swarm(TRIO.replace(swarm={"positions": circle[:51]}))
    assert "51 members takes minutes" in caplog.text
    with pytest.raises(PlanningError, match="at most 200: use the policies leader or") as caught:
        plan_swarm(TRIO.replace(swarm={"positions": circle}))
    assert caught.value.members == 201
