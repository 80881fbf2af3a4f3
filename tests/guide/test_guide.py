"""The guide's geometry and arithmetic, and both of its programs, against formulas written out."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import Array, single_agent_rate_by_hand

from casswarm import Candidate, Guide, Residuals, Saturation, Solution, Status, load_scenario, plan
from casswarm.guide import homotopy_signature
from casswarm.motion import integrate
from casswarm.nlp import Instances, Nlp
from casswarm.problems import (
    GuideTask,
    guide_instance,
    guide_nlp,
    penalised_guide_instance,
    penalised_guide_nlp,
)

RADARS = ((1.5, 0.8), (3.0, -1.0))
HAZARD = Saturation(RADARS)
TASK = GuideTask(
    start=np.array([0.0, 0.1]),
    center=np.array([4.0, 0.5]),
    radius=0.5,
    initial_velocity=np.array([1.0, -0.5]),
    a_max=0.4,
    a_max_first=0.7,
    v_max=2.0,
    dt=0.33,
)
FROM_ORIGIN = replace(TASK, start=np.zeros(2), center=np.full(2, 9.0))
SOLUTION = Solution(
    x=np.empty(0),
    objective=0.0,
    status=Status.SOLVED,
    message="",
    solver="none",
    residuals=Residuals(0.0, 0.0, 0.0),
    iterations=0,
    evaluations=0,
    build_seconds=0.0,
    solve_seconds=0.0,
)


def guide_along(velocities: Array, candidates: tuple[Candidate, ...] = ()) -> Guide:
    best = Candidate("straight", len(velocities), "", velocities, 1.0, SOLUTION)
    return Guide.from_candidate(HAZARD, FROM_ORIGIN, best, candidates)


def random_velocities(steps: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-2, 2, (steps, 2))


def arc(first: float, last: float) -> Array:
    """A path (40, 2) on the unit circle between two angles, in degrees."""
    angle = np.radians(np.linspace(first, last, 40))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


# --- trajectory and risk


def test_integrate_matches_dynamics_exactly() -> None:
    velocities, start = random_velocities(50, 0), np.array([0.1, -7.3])
    positions = integrate(start, velocities, 0.33)
    assert (positions[0] == start).all()
    assert (positions[1:] == positions[:-1] + 0.33 * velocities).all()


def test_guide_risk_sums_rates_after_start() -> None:
    guide = guide_along(random_velocities(7, 1))
    rates = [single_agent_rate_by_hand(x, y, RADARS) for x, y in guide.positions[1:]]
    np.testing.assert_allclose(guide.rates, rates, rtol=1e-12)
    assert guide.risk == pytest.approx(0.33 * sum(rates), rel=1e-12)
    assert guide.survival == pytest.approx(math.prod(math.exp(-0.33 * r) for r in rates))
    assert guide.arrival == 7


def test_guide_reference_after_arrival_is_target_center() -> None:
    guide = guide_along(random_velocities(3, 2))
    points = [guide.reference(step).tolist() for step in range(6)]
    assert points == [*guide.positions.tolist(), [9.0, 9.0], [9.0, 9.0]]


def test_guide_of_infinite_risk_does_not_arrive() -> None:
    best = Candidate("straight", 2, "", random_velocities(2, 3), math.inf, SOLUTION)
    lost = Guide.from_candidate(HAZARD, FROM_ORIGIN, best, (best,), "global")
    assert (lost.arrives, lost.search) == (False, "global")
    assert guide_along(random_velocities(2, 3)).arrives


def test_guide_gap_requires_risk_bound() -> None:
    guide = guide_along(random_velocities(3, 3))
    assert guide.gap is None
    assert "not certified" in str(guide)
    certified = replace(guide, risk_bound=0.75 * guide.risk)
    assert certified.gap == pytest.approx(0.25)
    shown = float(re.search(r"no guide can exceed ([0-9.]+)", str(certified))[1])
    assert math.exp(-0.75 * guide.risk) <= shown < math.exp(-0.75 * guide.risk) + 1e-4
    assert replace(guide, rates=0.0 * guide.rates, risk_bound=0.0).gap == 0.0
    assert "DOES NOT ARRIVE" in str(replace(guide, arrives=False))


def test_best_per_homotopy_class_sorts_arriving_candidates() -> None:
    velocities = random_velocities(2, 4)
    candidates = tuple(
        Candidate(f"start {i}", 2, sides, velocities, risk, SOLUTION)
        for i, (sides, risk) in enumerate(
            [("LR", 3.0), ("LL", 1.0), ("LR", 2.0), ("RR", math.inf), ("LL", 4.0), ("RL", 2.5)]
        )
    )
    best = guide_along(velocities, candidates).best_per_homotopy_class()
    assert [(c.homotopy, c.risk) for c in best] == [("LL", 1.0), ("LR", 2.0), ("RL", 2.5)]


# --- homotopy signature


STRAIGHT = [[0.0, 0.0], [4.0, 0.0]]
SIGNATURES = [
    *((STRAIGHT, [radar], "L") for radar in ((2.0, 4.0), (20.0, 0.4))),
    *((STRAIGHT, [radar], "R") for radar in ((2.0, -4.0), (-20.0, -0.4))),
    (STRAIGHT, [[3.0, 1.0], [1.0, -1.0], [2.0, 2.0]], "LRL"),  # in the order of radars
    (STRAIGHT, np.empty((0, 2)), ""),
    # beyond half a circle the winding counts
    *((arc(0, last), [[0.0, 0.0]], "L") for last in (170, 270)),
    *((arc(0, last), [[0.0, 0.0]], "R") for last in (-170, -300)),
    # turning before a radar is not going around it
    ([[0.0, 0.0], [1.0, 0.0], [1.5, 3.0]], [[2.0, 0.0]], "R"),
    ([[0.0, 0.0], [1.0, -1.0], [3.0, -1.0], [3.0, 1.0], [1.5, 3.0]], [[2.0, 0.0]], "L"),
]


@pytest.mark.parametrize(("path", "radars", "sides"), SIGNATURES)
def test_homotopy_signature_names_the_side_of_every_radar(path, radars, sides) -> None:
    assert homotopy_signature(np.array(path), np.array(radars)) == sides


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_homotopy_signature_swaps_on_reversal_and_mirroring(seed: int) -> None:
    path, radars = np.cumsum(random_velocities(12, seed), axis=0), random_velocities(3, seed + 1)
    swapped = homotopy_signature(path, radars).translate(str.maketrans("LR", "RL"))
    assert homotopy_signature(path[::-1], radars) == swapped
    assert homotopy_signature(path * [1, -1], radars * [1, -1]) == swapped


# --- the program by multiple shooting


def task_instance(horizon: int, arrival: int, seed: int) -> tuple[Nlp, Instances]:
    nlp = guide_nlp(HAZARD, horizon)
    return nlp, guide_instance(nlp, TASK, arrival, random_velocities(arrival, seed))


def test_guide_nlp_matches_written_out_formulas() -> None:
    """Positions are relative to the start, in steps of 0.66 at v_max = 2."""
    nlp, instance = task_instance(horizon=6, arrival=4, seed=5)
    rng = np.random.default_rng(6)
    X, V = rng.uniform(0, 4, (6, 2)), rng.uniform(-2, 2, (6, 2))
    x = nlp.pack_variables(positions=(X - TASK.start) / 0.66, velocities=V / 2.0)[0]
    objective, g = (np.asarray(part).ravel() for part in nlp.evaluate(x, instance.p[0]))

    risk = sum(0.33 * single_agent_rate_by_hand(*X[t], RADARS) for t in range(4))
    assert objective[0] == pytest.approx(risk, rel=1e-12)
    points, speeds = [TASK.start, *X], [TASK.initial_velocity, *V]
    dynamics = [points[t + 1] - points[t] - 0.33 * V[t] for t in range(6)]
    turns = [math.dist(speeds[t + 1], speeds[t]) ** 2 for t in range(6)]
    expected = [*np.ravel(dynamics), *turns, math.dist(X[-1], TASK.center) ** 2]
    units = [0.66] * 12 + [4.0] * 6 + [0.66**2]
    np.testing.assert_allclose(units * g, expected, rtol=1e-12, atol=1e-12)


def test_guide_instance_bounds_are_limits_until_arrival() -> None:
    nlp, instance = task_instance(horizon=6, arrival=4, seed=7)
    box = [[1.0, 1.0]] * 4 + [[0.0, 0.0]] * 2
    assert nlp.variable("velocities", instance.ubx[0]).tolist() == box
    assert nlp.variable("velocities", -instance.lbx[0]).tolist() == box
    assert np.isinf(nlp.variable("positions", instance.ubx[0])).all()
    names = np.array([name.partition("[")[0] for name in nlp.row_names])
    assert (instance.lbg[0, names == "dynamics"] == 0).all()
    assert (instance.ubg[0, names == "dynamics"] == 0).all()
    limits = instance.ubg[0, (names == "acceleration") | (names == "arrival")]
    exact = np.array([0.7 / 4, 0.1, 0.1, 0.1, math.inf, math.inf, (0.5 / 0.66) ** 2])
    np.testing.assert_allclose(limits, exact, rtol=0, atol=1.01e-7)
    assert (limits[np.isfinite(exact)] <= exact[np.isfinite(exact)] - 0.9e-7).all()


def test_guide_instance_start_obeys_dynamics_and_box() -> None:
    nlp = guide_nlp(HAZARD, 6)
    instance = guide_instance(nlp, TASK, 4, 3 * random_velocities(4, 8))
    V = nlp.variable("velocities", instance.x0[0])
    np.testing.assert_array_equal(V[:4], np.clip(3 * random_velocities(4, 8), -2, 2) / 2)
    np.testing.assert_array_equal(V[4:], 0.0)
    X = nlp.variable("positions", instance.x0[0])
    np.testing.assert_allclose(X, integrate(np.zeros(2), V, 1.0)[1:], rtol=1e-14)


# --- the paper's penalised program


def penalised(velocities: Array, gamma: float = 10.0) -> tuple[float, Array]:
    nlp = penalised_guide_nlp(HAZARD, len(velocities))
    instance = penalised_guide_instance(nlp, TASK, gamma, velocities)
    value, gradient = nlp.gradient(velocities.ravel(), instance.p[0])
    return float(value), np.asarray(gradient).reshape(-1, 2)


def penalised_by_hand(velocities: Array, gamma: float = 10.0) -> float:
    """-exp(-sum) + gamma d, equation by equation; the sum ends with the arrival step."""
    x, y = TASK.start
    risk, arrived = 0.0, False
    for vx, vy in velocities:
        x, y = x + 0.33 * vx, y + 0.33 * vy
        if not arrived:
            risk += 0.33 * single_agent_rate_by_hand(x, y, RADARS)
        arrived = arrived or math.dist((x, y), TASK.center) <= 0.5
    return -math.exp(-risk) + gamma * max(0.0, math.dist((x, y), TASK.center) - 0.5)


def through_the_target() -> Array:
    """Arrives at step 7 of 10 and leaves again, well away from the zone's edge at every step."""
    velocity = (TASK.center - TASK.start) / (0.33 * 7)
    return np.concatenate([np.tile(velocity, (7, 1)), np.tile([1.5, 1.0], (3, 1))])


def test_penalised_objective_matches_formula() -> None:
    for seed in range(5):
        velocities = random_velocities(8, seed) + np.array([1.0, 0.2])
        assert penalised(velocities)[0] == pytest.approx(penalised_by_hand(velocities), rel=1e-12)


def test_penalised_risk_ends_at_arrival() -> None:
    velocities = through_the_target()
    inside = np.hypot(*(integrate(TASK.start, velocities, 0.33) - TASK.center).T) <= 0.5
    assert inside.argmax() == 7
    assert not inside[-1]
    assert penalised(velocities)[0] == pytest.approx(penalised_by_hand(velocities), rel=1e-12)
    # what comes after the arrival moves the distance alone
    survival = [-penalised(v, gamma=1e-300)[0] for v in (velocities, velocities[:7])]
    assert survival[0] == pytest.approx(survival[1], rel=1e-12)


@pytest.mark.parametrize("velocities", [random_velocities(6, 9), through_the_target()])
def test_penalised_gradient_matches_finite_differences(velocities: Array) -> None:
    step = 1e-6
    differences = np.empty_like(velocities)
    for index in np.ndindex(*velocities.shape):
        change = np.zeros_like(velocities)
        change[index] = step
        differences[index] = (
            penalised_by_hand(velocities + change) - penalised_by_hand(velocities - change)
        ) / (2 * step)
    np.testing.assert_allclose(penalised(velocities)[1], differences, rtol=1e-6, atol=1e-7)
    to_center = np.tile((TASK.center - TASK.start) / (0.33 * 6), (6, 1))
    assert np.isfinite(penalised(to_center)[1]).all()


def test_penalised_instance_has_only_box_constraints() -> None:
    nlp = penalised_guide_nlp(HAZARD, 5)
    instance = penalised_guide_instance(nlp, TASK, 10.0, random_velocities(5, 10))
    assert nlp.sizes[2] == 0
    assert (instance.ubx == 2.0).all()
    assert (instance.lbx == -2.0).all()


def test_tiny_limit_of_acceleration_holds() -> None:
    """The solver's tolerance of the squared limit is larger than a hundredth of the limit here."""
    values = {"swarm.v_max": 4.3, "swarm.a_max": 1e-6, "guide.search": "local"}
    scenario = load_scenario("single-agent").with_values(values)
    guide = plan(scenario, certify=False)
    changes = np.hypot(*np.diff(guide.velocities, axis=0).T)
    assert changes.max() <= np.sqrt(scenario.guide_a_max)
