"""The joint plan: its probability against brute force, evaluate and sampling, and its search."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import Array, rate_by_hand, small

from casswarm import (
    Scenario,
    SolverError,
    SwarmPlan,
    evaluate,
    load_scenario,
    make_policy,
    plan,
    plan_swarm,
    simulate,
)
from casswarm.errors import PolicyError
from casswarm.planning.joint import PlanDistribution
from casswarm.planning.plan import initial_velocities
from casswarm.policies import JointPolicy
from casswarm.problems.joint import JointForm, joint_nlp
from casswarm.problems.joint_instances import JointTask, joint_instance

RADARS = [(1.0, 0.9), (2.2, -0.8)]


def pair(**values: object) -> Scenario:
    """Two members, two radars, eight steps."""
    return small([(0.0, 0.0), (0.4, 0.1)], (3.0, 0.2), RADARS, 8, **values)


def trio(**values: object) -> Scenario:
    positions = [(0.0, 0.0), (0.4, 0.1), (-0.2, 0.4)]
    return small(positions, (3.0, 0.2), RADARS, 8, **values)


@pytest.fixture(scope="module")
def planned() -> tuple[Scenario, SwarmPlan]:
    scenario = trio()
    return scenario, plan_swarm(scenario)


def by_hand(scenario: Scenario, positions: Array, objective: str) -> float:
    """What a run of the plan is worth in the mean, outcome by outcome, rate by rate."""
    dt, n = scenario.time.dt, scenario.n

    def value(step: int, alive: tuple[bool, ...]) -> float:
        if not any(alive) or step == len(positions) - 1:
            return 0.0 if objective != "survivors" else float(sum(alive))
        following = positions[step + 1]
        total = 0.0
        for fates in itertools.product((True, False), repeat=n):
            if any(f and not a for f, a in zip(fates, alive, strict=True)):
                continue
            p = 1.0
            for i in range(n):
                if alive[i]:
                    s = math.exp(-dt * rate_by_hand(i, following, alive, RADARS))
                    p *= s if fates[i] else 1 - s
            here = [
                fates[i] and math.dist(following[i], scenario.target.center) <= 0.5
                for i in range(n)
            ]
            if any(here):
                ends = {"success": 1.0, "arrivals": sum(here), "survivors": sum(fates)}
                total += p * float(ends[objective])
            else:
                total += p * value(step + 1, fates)
        return total

    return value(0, (True,) * n)


# --- the law


@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_law_of_random_ways_is_that_by_hand(objective: str) -> None:
    scenario = trio()
    rng = np.random.default_rng(7)
    ways = np.cumsum(np.vstack([np.zeros((1, 3, 2)), rng.normal(0.3, 0.3, (6, 3, 2))]), axis=0)
    positions = scenario.positions + ways
    law = PlanDistribution.from_positions(scenario, positions)
    found = (1 - law.cost(objective)) * (1 if objective == "success" else 3)
    assert found == pytest.approx(by_hand(scenario, positions, objective), abs=1e-12)


def test_success_is_what_evaluate_finds_for_the_policy(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, best = planned
    assert best.success is not None
    law = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert law.residual_mass == 0
    low, high = best.success
    assert low <= law.success[0] <= high
    assert high - low < 1e-10
    assert best.distribution is not None
    assert best.distribution.survivors_mean == pytest.approx(law.survivors_mean[0], abs=1e-12)
    np.testing.assert_allclose(best.distribution.arrival, law.arrival[: best.steps + 1], atol=1e-14)
    np.testing.assert_allclose(best.distribution.survival[-1], law.members, atol=1e-13)


def test_mass_is_conserved(planned: tuple[Scenario, SwarmPlan]) -> None:
    law = planned[1].distribution
    assert law is not None
    total = law.arrival.cumsum() + law.masses.sum(axis=1)
    np.testing.assert_allclose(total, 1.0, atol=1e-13)


def test_policy_is_never_clipped_and_agrees_with_sampling(
    planned: tuple[Scenario, SwarmPlan],
) -> None:
    scenario, best = planned
    study = simulate(
        scenario, [JointPolicy.from_plan(best)], runs=4000, seed=3, save_trajectories=0
    )
    row = study.summary.iloc[0]
    assert row["saturated"] == 0
    assert best.success is not None
    spread = 4 * math.sqrt(best.success[0] * (1 - best.success[0]) / 4000) + 1e-3
    assert abs(row["success"] - best.success[0]) < spread


def test_policy_by_name_is_that_of_the_plan(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, best = planned
    made = make_policy("joint", scenario)
    states = scenario.positions[None], best.initial_velocities[None], np.ones((1, 3), bool)
    np.testing.assert_array_equal(made.velocities(0, *states)[0], best.velocities[0])
    moved = states[0] + 0.01  # towards the next place, as near as the limits allow
    back = made.decide(0, moved, states[1], states[2]).velocities
    missing = moved + best.motion.dt * back - best.positions[1]
    assert np.hypot(missing[..., 0], missing[..., 1]).max() <= 0.01 * math.sqrt(2) + 1e-9
    assert not best.motion.sets(states[1]).violation(back).max() > 1e-9
    assert pickle.loads(pickle.dumps(made)).name == "joint"
    with pytest.raises(PolicyError, match="is for 3 members, the swarm has 2"):
        made.velocities(0, np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), np.ones((1, 2), bool))


# --- the program


@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
def test_objective_is_the_log_odds_of_the_laws_cost(objective: str) -> None:
    """With arrivals where the ways have them, the program prices what the chain does."""
    scenario = pair()
    guide = plan(scenario, certify=False)
    task = JointTask.from_scenario(scenario, initial_velocities(scenario, guide))
    form = JointForm(2, scenario.n_steps, True, objective)
    nlp = joint_nlp(scenario.hazard, form)
    straight = np.array([(2.85, 0.2), (2.45, 0.1)]) / (8 * scenario.time.dt)
    velocities = np.tile(straight, (8, 1, 1))
    positions = np.stack([scenario.positions + scenario.time.dt * t * straight for t in range(9)])
    first = scenario.target.contains(positions[1:]).argmax(axis=0) + 1
    assert (first > 1).all()
    instance = joint_instance(nlp, form, task, first, velocities[: first.max()])
    odds = float(nlp.evaluate(instance.x0[0], instance.p[0])[0])
    cost = PlanDistribution.from_positions(scenario, positions[: first.max() + 1]).cost(objective)
    assert odds == pytest.approx(math.log(cost / (1 - cost)), rel=1e-9)


def test_gradient_is_that_of_differences() -> None:
    scenario = pair()
    task = JointTask.from_scenario(scenario, np.zeros((2, 2)))
    for exact in (True, False):
        form = JointForm(2, scenario.n_steps, exact)
        nlp = joint_nlp(scenario.hazard, form)
        wild = np.random.default_rng(1).normal(1.2, 0.4, (8, 2, 2))
        instance = joint_instance(nlp, form, task, np.array([8, 7]), wild)
        x, p = instance.x0[0], instance.p[0]
        gradient = np.asarray(nlp.gradient(x, p)[1]).ravel()
        for row in range(0, len(x), 3):
            apart = 1e-6 * np.eye(len(x))[row]
            slope = float(nlp.evaluate(x + apart, p)[0] - nlp.evaluate(x - apart, p)[0]) / 2e-6
            assert slope == pytest.approx(float(gradient[row]), rel=1e-5, abs=1e-7)


def test_mean_field_of_one_member_is_exact() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.2), RADARS, 8)
    task = JointTask.from_scenario(scenario, np.zeros((1, 2)))
    ways = np.random.default_rng(2).normal(1.2, 0.3, (8, 1, 2))
    odds = []
    for exact in (True, False):
        form = JointForm(1, scenario.n_steps, exact)
        nlp = joint_nlp(scenario.hazard, form)
        instance = joint_instance(nlp, form, task, np.array([8]), ways)
        odds.append(float(nlp.evaluate(instance.x0[0], instance.p[0])[0]))
    assert odds[0] == pytest.approx(odds[1], rel=1e-9)


def test_program_pickles() -> None:
    nlp = joint_nlp(pair().hazard, JointForm(2, 8))
    again = pickle.loads(pickle.dumps(nlp))
    x, p = np.full(nlp.sizes[0], 0.3), np.full(nlp.sizes[1], 0.5)
    assert float(again.evaluate(x, p)[0]) == float(nlp.evaluate(x, p)[0])


# --- the search


def test_limits_hold_exactly(planned: tuple[Scenario, SwarmPlan]) -> None:
    scenario, best = planned
    assert np.abs(best.velocities).max() <= scenario.swarm.v_max
    change = np.diff(np.concatenate([best.initial_velocities[None], best.velocities]), axis=0)
    assert (change**2).sum(axis=-1).max() <= scenario.swarm.a_max * (1 + 1e-9)
    assert scenario.target.contains(best.positions[best.arrivals, np.arange(3)]).all()
    assert best.arrivals.max() == best.steps


def test_one_member_alone_does_as_well_as_the_guide() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.2), RADARS, 10, swarm__velocity=(1.0, 0.0))
    guide = plan(scenario, search="global", certify=False)
    best = plan_swarm(scenario)
    assert best.success is not None
    assert best.success[1] >= guide.survival - 1e-6
    assert best.value == pytest.approx(math.exp(-sum_of_risk(scenario, best)), abs=1e-12)


def sum_of_risk(scenario: Scenario, best: SwarmPlan) -> float:
    rates = scenario.hazard.single_agent_rates(best.positions[1 : best.arrivals[0] + 1, 0])
    return float(scenario.time.dt * rates.sum())


def test_joint_plan_beats_policies_of_the_paper() -> None:
    scenario = pair()
    best = plan_swarm(scenario)
    assert best.success is not None
    for name in ("naive", "leader"):
        assert best.success[0] >= evaluate(scenario, name, 1e-2).success[1] - 1e-2


@pytest.mark.parametrize(
    ("name", "least", "seeds"), [("paper-1", 0.999, (0, 5)), ("paper-2", 0.99, (1,))]
)
def test_papers_swarms_get_through_whatever_the_seed(
    name: str, least: float, seeds: tuple[int, ...]
) -> None:
    scenario = load_scenario(name)
    found = [
        plan_swarm(scenario, seed=s, initial_guesses=["formations", "perturbed"]) for s in seeds
    ]
    for best in found:
        assert best.success is not None
        assert best.success[0] > least
        assert best.bound is not None
        assert best.success[1] <= float(best.bound)
    assert abs(found[0].value - found[-1].value) < 1e-3


def test_members_keep_their_distance_where_asked() -> None:
    scenario = pair()
    close = plan_swarm(scenario, initial_guesses=["formations"])
    apart = plan_swarm(scenario, initial_guesses=["formations"], min_distance=0.3)
    assert close.least_distance < 0.1
    assert apart.least_distance >= 0.3 - 1e-5
    assert apart.value < close.value


def test_members_that_do_not_fit_into_the_target_together_arrive_one_by_one() -> None:
    positions = [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)]
    scenario = small(positions, (3.0, 0.2), RADARS, 6)
    best = plan_swarm(scenario, initial_guesses=["formations"], min_distance=0.95)
    assert best.least_distance >= 0.949
    assert len(set(best.arrivals.tolist())) == 3
    assert "COME WITHIN" not in str(best)
    assert "COME WITHIN 0.95" in str(replace(best, min_distance=2.0))


def test_arrivals_come_together_and_survivors_may_not() -> None:
    scenario = pair()
    found = {
        o: plan_swarm(scenario, o, initial_guesses=["formations"])
        for o in ("arrivals", "survivors")
    }
    arriving = found["arrivals"]
    assert len(set(arriving.arrivals.tolist())) == 1
    assert arriving.distribution is not None
    assert arriving.value == pytest.approx(arriving.distribution.arrivals_mean, abs=1e-12)
    assert found["survivors"].distribution is not None
    assert found["survivors"].value == pytest.approx(found["survivors"].distribution.survivors_mean)
    success = plan_swarm(scenario, initial_guesses=["formations"])
    assert success.distribution is not None
    assert arriving.value >= success.distribution.arrivals_mean - 1e-6
    assert found["survivors"].value >= success.distribution.survivors_mean - 1e-6


def test_a_member_too_far_away_is_not_asked_to_arrive() -> None:
    scenario = small([(0.0, 0.0), (-9.0, 0.0)], (3.0, 0.2), RADARS, 8)
    best = plan_swarm(scenario, initial_guesses=["formations"])
    assert best.arrivals[0] > 0
    assert best.arrivals[1] == 0
    assert "1 of 2 members DO NOT ARRIVE" in str(best)
    law = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert best.success is not None
    assert best.success[0] <= law.success[0] <= best.success[1]


def gentle(positions: ca.MX, alive: ca.MX, radars: tuple[tuple[float, float], ...]) -> ca.MX:
    """Rates that are no kernels: the nearer to a radar, the fewer alive."""
    (x, y) = radars[0]
    away = (positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2
    return 1.0 / (0.2 + away) / ca.sum1(alive)


def test_rates_of_users_are_planned_for_too() -> None:
    scenario = pair().with_hazard(gentle, radars=[(1.5, 0.0)])
    best = plan_swarm(scenario, initial_guesses=["formations"])
    law = evaluate(scenario, JointPolicy.from_plan(best), tolerance=0)
    assert best.success is not None
    assert best.success[0] <= law.success[0] <= best.success[1]
    assert best.bound is not None
    assert not best.bound.certified
    assert "CustomHazard does not provide" in str(best)


def test_large_swarms_are_planned_by_the_mean_field() -> None:
    rng = np.random.default_rng(4)
    positions = [tuple(map(float, place)) for place in rng.uniform(-0.4, 0.4, (12, 2))]
    scenario = small(positions, (3.0, 0.2), RADARS, 8)
    best = plan_swarm(scenario)
    assert best.distribution is None
    assert best.success is None
    assert "by the mean field" in str(best)
    assert (best.arrivals > 0).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=2, deadline=None)
def test_swarms_turned_and_mirrored_do_as_well(seed: int) -> None:
    """A quarter turn and a mirror keep the speed limit's square."""
    rng = np.random.default_rng(seed)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]]) @ np.diag([1.0, rng.choice([-1.0, 1.0])])
    starts = rng.uniform(-0.3, 0.3, (2, 2))
    places = np.vstack([starts, [(2.0, 0.3)], RADARS])
    values = []
    for way in (np.eye(2), turn):
        moved = [tuple(map(float, way @ place)) for place in places]
        velocity = tuple(map(float, way @ [1.0, 0.2]))
        scenario = small(moved[:2], moved[2], moved[3:], 6, swarm__velocity=velocity)
        values.append(plan_swarm(scenario, initial_guesses=["formations"]).value)
    assert values[0] == pytest.approx(values[1], abs=1e-4)


# --- wrong input


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"objective": "sucess"}, "did you mean 'success'"),
        ({"initial_guesses": ["formation"]}, "did you mean 'formations'"),
        ({"initial_guesses": "own"}, "expected a list of"),
        ({"solver": "ipoptt"}, "ipopt"),
    ],
)
def test_wrong_words_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(SolverError, match=message):
        plan_swarm(pair(), **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"min_distance": 0.0}, "above 0"),
        ({"min_distance": 0.6}, "members start 0.412311 apart; choose a smaller distance"),
        ({"time_limit": 0.0}, "seconds above 0"),
    ],
)
def test_numbers_out_of_range_are_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan_swarm(pair(), **wrong)  # type: ignore[arg-type]
