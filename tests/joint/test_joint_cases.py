"""Joint plans for a hazard that is not known: exact laws, replanning, mixtures, invariances."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw
from casswarm.errors import PlanningError, ScenarioError
from casswarm.joint import CasesDistribution, PlanTree, plan_law

WALL = [[1.5, y] for y in (-2.0, -1.2, -0.4, 0.4, 1.2, 2.0)]


def gaps(n: int = 2, **values: object) -> csw.Scenario:
    """A wall of radars that lacks one of two, symmetric about the way."""
    cases = [{"radars": [r for r in WALL if r[1] != gap]} for gap in (0.4, -0.4)]
    positions = [(0.0, 0.3), (0.0, -0.3), (-0.3, 0.0)][:n]
    base = small(positions, (3.0, 0.0), [(9.0, 9.0)], 8, swarm__velocity=[1.0, 0.0])
    base = base.with_values({"swarm.a_max": 2.0, "hazard.radars": None, "hazard.case": cases})
    return base.with_values(values)


@pytest.fixture(scope="module")
def plan() -> csw.SwarmPlan:
    return csw.plan_swarm(gaps())


def test_plan_has_the_exact_law_of_the_prior(plan: csw.SwarmPlan) -> None:
    scenario, law = gaps(), plan.distribution
    assert isinstance(law, CasesDistribution)
    exact = csw.evaluate(scenario, "joint", 0.0)
    assert plan.value == pytest.approx(exact.success.low, abs=1e-12)
    np.testing.assert_allclose(law.arrival, exact.arrival[: len(law.arrival)], atol=1e-14)
    np.testing.assert_allclose(law.survival[-1], exact.members, atol=1e-13)
    for case, (_, theirs) in zip(law.cases, exact.cases, strict=True):
        assert 1.0 - case.failure == pytest.approx(theirs.success.low, abs=1e-12)
    assert law.success.low <= exact.success.low <= law.success.high + 1e-12
    assert plan.bound is not None
    assert law.success.high <= plan.bound.value
    assert "by case" in str(plan)


@pytest.mark.slow
def test_plan_is_at_least_as_good_as_those_of_other_hazards(plan: csw.SwarmPlan) -> None:
    scenario = gaps()
    for other in (scenario.believed, *(case.scenario for case in scenario.cases)):
        positions = csw.plan_swarm(other, certify=False).positions
        assert plan.value >= 1.0 - plan_law(scenario, positions).failure - 1e-6


@pytest.mark.slow
def test_survivors_replan_for_the_posterior_and_are_no_worse() -> None:
    scenario = gaps(3)
    first = csw.plan_swarm(scenario, certify=False)
    again = csw.evaluate(scenario, "joint-replanning", 0.0)
    assert again.success.low >= first.value - 1e-12
    tree = PlanTree(scenario, first, min_probability=0.0)
    (root,) = tree._by_position[0, 0, first.positions[0, 0].tobytes()]
    members = (0, 2)
    last = 3
    assert last < first.steps
    probabilities = root.entering(last, members)
    hazards = [case.scenario.hazard for case in scenario.cases]
    expected = np.full(2, 0.5)
    for k, hazard in enumerate(hazards):
        for step in range(1, last + 1):
            p = np.exp(-0.33 * hazard.rates(first.positions[step]))
            expected[k] *= p.prod() if step < last else p[0] * (1 - p[1]) * p[2]
    np.testing.assert_allclose(probabilities, expected, rtol=1e-9)


@pytest.mark.slow
def test_mixture_against_the_worst_prior() -> None:
    scenario = gaps()
    mixed = csw.plan_swarm_mixture(scenario, "worst")
    mean = csw.plan_swarm(scenario, certify=False).value
    assert mixed.pure_value <= mixed.value.low <= mean + 1e-4
    assert mixed.value.low <= mixed.value.high
    assert mixed.value.low <= mixed.known_value + 1e-9
    np.testing.assert_allclose(mixed.weights @ mixed.survivals, mixed.survival)
    for planned, successes in zip(mixed.plans, mixed.survivals, strict=True):
        law = plan_law(scenario, planned.positions)
        assert isinstance(law, CasesDistribution)
        np.testing.assert_allclose([1 - case.failure for case in law.cases], successes, atol=1e-9)
    # mirrored about the way, and with the cases in the other order
    tables = list(scenario.hazard_table.case)
    other = scenario.with_values({"hazard.case": [dict(t.given) for t in reversed(tables)]})
    turned = csw.plan_swarm_mixture(other, "worst", certify=False)
    assert turned.value.low == pytest.approx(mixed.value.low, abs=2e-3)


def test_images_have_equal_plans(plan: csw.SwarmPlan) -> None:
    scenario, turn = gaps(), np.array([[0.0, -1.0], [1.0, 0.0]])
    cases = [{"radars": (np.array(t.radars) @ turn.T).tolist()} for t in scenario.hazard_table.case]
    turned = scenario.with_values(
        {
            "swarm.positions": (scenario.positions @ turn.T).tolist(),
            "swarm.velocity": [0.0, 1.0],
            "target.center": [0.0, 3.0],
            "hazard.case": cases,
        }
    )
    other = csw.plan_swarm(turned, certify=False)
    assert other.value == pytest.approx(plan.value, abs=1e-9)


@pytest.mark.slow
def test_mixture_of_the_mean_is_one_plan(plan: csw.SwarmPlan) -> None:
    mixed = csw.plan_swarm_mixture(gaps(), "mean", certify=False)
    assert mixed.value.low == pytest.approx(plan.value, abs=1e-9)
    assert mixed.weights.tolist() == [1.0]
    assert str(mixed).startswith("mixture of 1 joint plan for mean: success")
    assert "best single joint plan" in str(mixed)
    known = csw.plan_swarm_mixture(gaps().cases[0].scenario, "worst", certify=False)
    assert known.survivals.shape == (1, 1)
    assert mixed.plot(gaps()) is not None


def test_wrong_requests_are_refused() -> None:
    with pytest.raises(TypeError, match="takes no 'objective'; allowed: guide"):
        csw.plan_swarm_mixture(gaps(), objective="survivors")
    with pytest.raises(PlanningError, match="ambiguity = 'best'"):
        csw.plan_swarm_mixture(gaps(), "best")
    positions = [[0.02 * k, 0.0] for k in range(11)]
    many = gaps().with_values({"swarm.positions": positions})
    with pytest.raises(PlanningError, match="at most 10"):
        csw.plan_swarm_mixture(many.cases[0].scenario)
    with pytest.raises(ScenarioError, match=r"2 cases of its .* more than 10 members treats only"):
        csw.plan_swarm(many)
