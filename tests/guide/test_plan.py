"""Plans: against grids and brute force, their successes, and what happens where there is none."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from backend_cases import GATE
from failing_solver import Failing
from small_scenarios import DT, V_MAX, patrolled, single_agent_rate_by_hand, small

from casswarm import (
    CasswarmWarning,
    Guide,
    PlanningError,
    Scenario,
    Status,
    load_scenario,
    plan,
    plan_baseline,
)
from casswarm.guide import plan_from
from casswarm.nlp import Instances, Nlp

MEMBER = [(0.0, 0.0)]


@cache
def two_radars(**values: object) -> Guide:
    """Start (0, 0), target (10, 10), radars (3, 4) and (7, 6), Table I's numbers."""
    return plan(small(MEMBER, (10.0, 10.0), [(3.0, 4.0), (7.0, 6.0)], 30, **values))


# --- against independent solutions


def test_plan_global_search_goes_around_radars() -> None:
    local = two_radars(guide__acceleration_limited=False, guide__search="local")
    globally = two_radars(guide__acceleration_limited=False)
    assert local.risk == pytest.approx(1.156, abs=0.001)
    assert globally.risk == pytest.approx(0.3305, abs=0.0005)
    assert globally.arrival == local.arrival == 30
    sides = [min(guide.candidates, key=lambda c: c.risk).homotopy for guide in (local, globally)]
    assert sides == ["LR", "LL"]


def test_plan_low_risk_keeps_homotopy_classes() -> None:
    """Ten times as far from the radars: a tenth of the risk, below the weight of a barrier."""
    radars = [(30.0, 40.0), (70.0, 60.0)]
    scenario = small(MEMBER, (100.0, 100.0), radars, 300, guide__acceleration_limited=False)
    guide = plan(scenario, certify=False)
    assert guide.risk == pytest.approx(0.0344, abs=0.0002)
    assert [c.homotopy for c in guide.best_per_homotopy_class()[:2]] == ["LL", "RR"]


def patrol(steps: int, **values: object) -> Scenario:
    """A rate that makes time cost something, so that arriving early may pay."""
    scenario = small(MEMBER, (5.0, 1.0), [(2.5, 0.2)], steps, guide__search="local", **values)
    return scenario.with_hazard(patrolled, radars=[(2.5, 0.2)], background=0.02)


@pytest.mark.slow
def test_plan_arrival_step_is_best_of_all() -> None:
    guide = plan(patrol(40))
    every = [plan(patrol(steps, guide__arrival="horizon")) for steps in range(8, 41)]
    best = min(every, key=lambda other: other.risk)
    assert 8 < best.arrival < 40  # neither the first nor the last
    assert guide.arrival == best.arrival
    assert guide.risk == pytest.approx(best.risk, rel=1e-7)
    tried = {c.arrival for c in guide.candidates}
    assert {guide.arrival - 1, guide.arrival + 1} <= tried
    assert len(tried) < 20


@pytest.mark.parametrize(("target", "steps"), [((6.0, 0.0), 9), ((4.0, 4.0), 6), ((0.0, -3.0), 4)])
def test_plan_uniform_rate_is_straight_and_shortest(
    target: tuple[float, float], steps: int
) -> None:
    scenario = small(MEMBER, target, [(50.0, 50.0)], 30)
    guide = plan(scenario.with_hazard(patrolled, background=0.3))
    assert guide.arrival == steps
    assert guide.risk == pytest.approx(0.3 * steps * DT, rel=1e-12)
    across = np.array([-target[1], target[0]]) / math.hypot(*target)
    assert np.abs(guide.positions @ across).max() < 1e-6


# --- what every guide obeys

PLANS = {
    "acceleration_limited": {},
    "unlimited": {"guide__acceleration_limited": False},
    "own limit": {"guide__a_max": 0.1},
    "no margin": {"guide__margin": 0.0, "swarm__a_max": 0.02},
    "given velocity": {"swarm__velocity": [0.3, -1.0]},
    "horizon": {"guide__arrival": "horizon", "guide__margin": 0.3},
}


@pytest.mark.parametrize("values", PLANS.values(), ids=PLANS.keys())
def test_plan_satisfies_dynamics_limits_and_arrival(values: dict[str, object]) -> None:
    scenario = small(MEMBER, (6.0, 4.0), [(2.0, 2.0), (4.5, 1.5)], 20, **values)
    guide = plan(scenario, certify=False)
    X, V = guide.positions, guide.velocities
    assert guide.solution.status is Status.SOLVED
    assert X[0].tolist() == [0.0, 0.0]
    assert (X[1:] == X[:-1] + DT * V).all()
    assert np.abs(V).max() <= V_MAX
    assert (np.diff(V, axis=0) ** 2).sum(axis=1).max() <= scenario.guide_a_max
    distances = np.hypot(*(X - [6.0, 4.0]).T)
    assert (distances[:-1] > 0.5).all()  # it ends at its first arrival
    assert distances[-1] <= 0.5 - scenario.arrival_margin
    rates = [single_agent_rate_by_hand(x, y, scenario.hazard_table.radars) for x, y in X[1:]]
    assert guide.risk == pytest.approx(DT * sum(rates), rel=1e-12)


def test_plan_initial_velocity_limits_first_change() -> None:
    """The members' own limit bounds the first change, the guide's the later ones."""
    scenario = small(MEMBER, (6.0, 4.0), [(2.0, 2.0)], 20, guide__a_max=0.3)
    backwards = (-1.5, -1.5)
    free = plan(scenario)
    for guide in (
        plan(scenario.with_values({"swarm.velocity": backwards})),
        plan_from(scenario, (0.5, -0.5), initial_velocity=backwards),
    ):
        first = math.dist(guide.velocities[0], backwards) ** 2
        assert 0.3 < first <= 0.5 < math.dist(free.velocities[0], backwards) ** 2
        assert (np.diff(guide.velocities, axis=0) ** 2).sum(axis=1).max() <= 0.3
    assert guide.positions[0].tolist() == [0.5, -0.5]


def test_plan_ends_at_first_arrival() -> None:
    scenario = load_scenario("paper-1").with_values(GATE)
    guide = plan(scenario, certify=False)
    assert guide.arrival < scenario.n_steps  # planned for the horizon, and at the rim before it
    inside = scenario.target.contains(guide.positions)
    assert inside[-1]
    assert not inside[:-1].any()
    assert guide.reference(guide.arrival).tolist() == guide.positions[-1].tolist()
    assert guide.reference(guide.arrival + 1).tolist() == list(scenario.target.center)


def test_plan_from_near_matches_full_search() -> None:
    scenario = small(MEMBER, (6.0, 4.0), [(2.0, 2.0), (4.5, 1.5)], 20)
    neighbour, start = plan(scenario), (0.3, -0.2)
    full = plan_from(scenario, start)
    near = plan_from(scenario, start, near=neighbour)
    assert near.risk == pytest.approx(full.risk, rel=1e-6)
    assert len(near.candidates) < len(full.candidates)
    # a guide without candidates offers no start
    assert plan_from(scenario, start, near=replace(neighbour, candidates=())).risk == full.risk


# --- searches


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "radars", "steps"),
    [
        ((8.1, 5.4), [(4.1, 8.1)], 25),  # the straight start has the best arrival step
        ((6.0, 4.0), [(2.0, 2.0), (4.5, 1.5), (3.0, 4.0)], 20),
        ((4.0, 0.0), [(2.0, 0.1)], 12),
    ],
)
def test_plan_wider_search_is_never_worse(target, radars, steps) -> None:
    def risk(search: str, arrival: str) -> float:
        values = {"guide__search": search, "guide__arrival": arrival}
        return plan(small(MEMBER, target, radars, steps, **values)).risk

    room = 1 + 1e-9  # two starts that end in the same minimum do so to a solver's tolerance
    assert risk("global", "any") <= room * risk("local", "any")
    assert risk("local", "any") <= room * risk("local", "horizon")
    assert risk("global", "any") <= room * risk("global", "horizon")
    assert risk("global", "horizon") <= room * risk("local", "horizon")


def test_plan_search_argument_overrides_scenario() -> None:
    scenario = small(MEMBER, (4.0, 0.0), [(2.0, 0.1)], 12)
    tasks: set[str] = set()
    guide = plan(scenario, search="local", progress=lambda task, *_: tasks.add(task.split(" (")[0]))
    assert {c.start for c in guide.candidates} == {"straight"}
    assert tasks == {"optimising straight line", "proving a lower bound"}


def test_plan_candidates_cover_homotopy_classes() -> None:
    guide = two_radars()
    tried: dict[str, set[int]] = {}
    for candidate in guide.candidates:
        tried.setdefault(candidate.start, set()).add(candidate.arrival)
    assert {"straight", "LL", "RR"} <= tried.keys()
    assert {15, 30} <= tried["straight"]  # the fewest possible steps and all of them
    assert {29, 30} <= tried["LL"]  # the best arrival step without limits, and next to it
    assert guide.risk == min(c.risk for c in guide.candidates)


def odd_arrivals(nlp: Nlp, instances: Instances) -> list[bool]:
    moving = [(nlp.variable("velocities", ubx)[:, 0] > 0).sum() for ubx in instances.ubx]
    return [bool(count % 2) for count in moving]


def test_plan_keeps_failed_candidates_without_choosing_them() -> None:
    scenario = small(MEMBER, (4.0, 0.0), [(2.0, 0.1)], 13, guide__arrival="any")
    guide = plan(scenario, Failing(odd_arrivals), certify=False)
    assert {c.solution.status for c in guide.candidates} == {Status.SOLVED, Status.DIVERGED}
    for candidate in guide.candidates:
        failed = candidate.arrival % 2 == 1
        assert (candidate.solution.message == "no mood") == failed
        assert math.isinf(candidate.risk) == failed
    assert guide.solution.status is Status.SOLVED
    assert guide.arrival % 2 == 0


# --- where there is no guide


def impossible(a_max: float) -> Scenario:
    """Full speed away from the target, and a small acceleration limit."""
    values = {"swarm__velocity": [-2.0, -2.0], "swarm__a_max": a_max, "guide__search": "local"}
    return small(MEMBER, (10.0, 10.0), [(3.0, 4.0), (7.0, 6.0)], 30, **values)


@pytest.mark.slow
def test_plan_without_arrival_raises_and_counts_outcomes() -> None:
    expected = r"of (\d+) solves \(\d+ infeasible\b.*\) none arrives .* check=False"
    with pytest.raises(PlanningError, match=expected) as failure:
        plan(impossible(1e-4))
    outcomes = failure.value.outcomes
    assert not {"solved", "acceptable"} & set(outcomes)
    counted = ", ".join(f"{count} {status}" for status, count in outcomes.items())
    assert f"of {sum(outcomes.values())} solves ({counted})" in str(failure.value)


@pytest.mark.parametrize(
    "a_max", [1e-2, *(pytest.param(a_max, marks=pytest.mark.slow) for a_max in (1e-4, 0.1))]
)
def test_plan_unchecked_returns_guide_without_arrival(a_max: float) -> None:
    """Nor does a path that arrives by violating its limits count, such as solvers give up with."""
    guide = plan(impossible(a_max), check=False)
    assert not guide.arrives
    assert not guide.solution.status.success
    assert guide.solution.residuals.violation > 0.1
    assert all(math.isinf(c.risk) for c in guide.candidates)
    assert np.isfinite(guide.positions).all()


# --- the paper's penalised form


def test_plan_projected_gradient_respects_box_and_arrives() -> None:
    scenario = load_scenario("paper-1")
    guide = plan(scenario, "projected-gradient")
    assert guide.arrives
    assert np.abs(guide.velocities).max() <= V_MAX
    assert (guide.positions[1:] == guide.positions[:-1] + DT * guide.velocities).all()
    inside = scenario.target.contains(guide.positions)
    assert inside.nonzero()[0].tolist() == [guide.arrival]
    assert [c.start for c in guide.candidates] == ["straight"]
    assert guide.solution.solver == "projected-gradient"


def test_plan_projected_gradient_is_not_better_than_global_search() -> None:
    scenario = small(MEMBER, (4.0, 0.5), [(2.0, 1.2)], 12, guide__acceleration_limited=False)
    line = small(MEMBER, (4.0, 0.5), [(2.0, 1.2)], 12, guide__iterations=1)
    paper = plan(scenario, "projected-gradient")
    assert plan(scenario).risk <= paper.risk < plan(line, "projected-gradient").risk


@pytest.mark.parametrize("certify", [True, False])
def test_plan_baseline_has_the_bound_of_its_guide_without_limits(certify: bool) -> None:
    scenario = load_scenario("single-agent")
    guide = plan(scenario, certify=certify)
    baseline = plan_baseline(scenario, guide)
    assert baseline.arrives
    assert baseline.search == "global"
    assert baseline.risk < guide.risk
    certificate = guide.certificate
    assert baseline.risk_bound == (None if certificate is None else certificate.bound)
    assert baseline.certificate is None or baseline.certificate.accelerated is None


def test_best_paths_are_those_of_the_homotopy_classes() -> None:
    guide = plan(load_scenario("single-agent"), certify=False)
    paths, classes = guide.best_paths(), guide.best_per_homotopy_class()
    assert list(paths) == [f"{best.homotopy} {rank}" for rank, best in enumerate(classes)]
    assert len(paths) > 1
    for path, best in zip(paths.values(), classes, strict=True):
        assert path.shape == (len(best.velocities) + 1, 2)
        np.testing.assert_allclose(np.diff(path, axis=0), guide.dt * best.velocities, atol=1e-12)
    np.testing.assert_array_equal(next(iter(paths.values())), guide.positions)


def test_guide_values_by_name_count_all_starts() -> None:
    guide = plan(load_scenario("single-agent"))
    values = guide.as_dict()
    assert sum(guide.outcomes.values()) == len(guide.candidates) == len(values["candidates"])
    assert values["risk_bound"] == values["certificate"]["accelerated"]["bound"]
    assert values["gap"] == guide.gap


# --- no solve that succeeds

REASON = "the derivative of the objective with respect to positions[0] is nan"


def rooted(positions, _alive):
    """The rate 1, with derivatives that are not a number."""
    return 1.0 + ca.sqrt(ca.fmax(-1.0 - positions[:, 0] ** 2, 0.0))


def test_plan_of_which_every_solve_failed_warns_with_the_reason():
    scenario = small([(0.0, 0.0)], (2.0, 0.0), [(1.0, 0.8)], 6).with_hazard(rooted)
    with pytest.warns(CasswarmWarning, match="not a minimum: no solve succeeded") as warned:
        guide = plan(scenario)
    assert guide.failed
    assert guide.arrives
    assert guide.certificate is None
    assert str(warned[0].message) == guide.note
    assert REASON in guide.note
    assert guide.note in str(guide)
    assert guide.as_dict()["note"] == guide.note
