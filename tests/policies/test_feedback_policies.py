"""Feedback policies: best steps against enumeration, decisions, and success."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import DT, Array, single_agent_rate_by_hand, small

from casswarm import evaluate, make_policy, plan
from casswarm.grid import ValueFunction
from casswarm.guide import plan_from
from casswarm.motion import PlanarSets
from casswarm.policies.formation_policies import FeedbackPolicy

RADARS = [(2.0, 1.2), (3.0, -1.0)]
POSITIONS = [(0.0, 0.0), (0.8, -0.9), (-0.7, 0.7), (-0.6, -0.8)]  # apart: off any one guide
NAMES = ("leader-feedback", "constrained-feedback")
STOPS = 3 + math.ceil(2.0 / math.sqrt(0.5))  # steps of a manoeuvre

SCENARIO = small(POSITIONS, (5.0, 0.5), RADARS, 16, guide__search="global")
"""Four dispersed members, two radars between start and target."""

Flags = NDArray[np.bool_]


@cache
def policy(name: str) -> FeedbackPolicy:
    found = make_policy(name, SCENARIO)
    assert isinstance(found, FeedbackPolicy)
    return found


def states(batch: int, seed: int) -> tuple[Array, Array, Flags]:
    """States between start and target, with zero entries of the destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, 4)) < 0.7
    alive[:, 0] |= ~alive.any(axis=1)
    positions = rng.uniform((-0.5, -1), (4, 1), (batch, 1, 2)) + rng.normal(0, 0.4, (batch, 4, 2))
    previous_velocities = rng.uniform(-2, 2, (batch, 4, 2))
    living = alive[..., None]
    return positions * living, previous_velocities * living, alive


# --- best steps


def test_best_step_equals_enumeration_of_manoeuvres() -> None:
    step, position, before = 4, np.array([0.7, -0.4]), np.array([1.1, -0.6])
    found = policy("leader-feedback")
    best = (math.inf, position)
    for aim in itertools.product(np.linspace(-2, 2, 9), repeat=2):
        x, v, risk, first = position, before, 0.0, position
        for k in range(1, STOPS + 1):
            missing = np.array(aim) - v
            v = v + missing * min(1.0, math.sqrt(0.5) / max(math.hypot(*missing), 1e-300))
            x = x + DT * v
            first = x if k == 1 else first
            cost = DT * single_agent_rate_by_hand(*x, RADARS)
            if k == STOPS:
                risk += float(found.value.after(step + k, x))  # its own cost and what follows
                break
            risk += cost
            if math.dist(x, (5.0, 0.5)) <= 0.5:
                break
        best = min(best, (risk, first), key=lambda pair: pair[0])
    points, risks = found.best_steps(step, position[None], before[None])
    assert risks[0] == pytest.approx(best[0], rel=1e-12)
    np.testing.assert_allclose(points[0], best[1], atol=1e-12)


def test_best_step_without_time_to_arrive_heads_straight_to_target() -> None:
    position, before = np.array([[-1.0, 0.5]]), np.array([[1.9, 0.0]])
    points, risks = policy("leader-feedback").best_steps(14, position, before)
    assert np.isinf(risks).all()
    assert points[0] == pytest.approx([-1.0 + DT * 2.0, 0.5])


def followed(positions: Array, previous_velocities: Array) -> Array:
    """Risks of isolated agents that follow the feedback guide; infinite without arrival."""
    task, x, v = SCENARIO, positions, previous_velocities
    risk, arrived = np.zeros(len(x)), np.zeros(len(x), bool)
    for step in range(task.n_steps):
        y = policy("leader-feedback").best_steps(step, x, v)[0]
        moved = (y - x) / DT
        assert (np.hypot(*(moved - v)[~arrived].T) <= math.sqrt(0.5) * (1 + 1e-9)).all()
        assert np.abs(moved).max() <= 2.0 * (1 + 1e-9)
        x, v = np.where(arrived[:, None], x, y), np.where(arrived[:, None], v, moved)
        risk += np.where(arrived, 0.0, DT * task.hazard.single_agent_rates(x))
        arrived |= task.target.contains(x)
    return np.where(arrived, risk, np.inf)


def test_feedback_guide_with_time_left_arrives() -> None:
    rng = np.random.default_rng(5)
    x, v = rng.uniform((-0.5, -0.5), (1.0, 0.5), (100, 2)), rng.uniform(-2, 2, (100, 2))
    assert np.isfinite(policy("leader-feedback").best_steps(0, x, v)[1]).all()
    risks = followed(x, v)
    assert np.isfinite(risks).all()
    assert (ValueFunction.from_scenario(SCENARIO).bounds(0, x)[0] <= risks).all()


def test_feedback_guide_risk_is_within_factor_of_best_guide() -> None:
    x = np.array([[0.0, 0.0], [0.4, -0.4], [0.0, 0.8], [-0.4, -0.2]])
    v = np.array([[0.0, 1.0], [1.0, 1.0], [-0.5, 0.5], [0.0, 0.0]])
    starts = zip(x, v, strict=True)
    best = [plan_from(SCENARIO, position, initial_velocity=u).risk for position, u in starts]
    ratios = followed(x, v) / best
    assert (ratios >= 1 - 1e-6).all()
    assert ratios.max() < 1.5


def test_single_agent_distribution_matches_feedback_guide() -> None:
    alone = small(POSITIONS[:1], (5.0, 0.5), RADARS, 16, guide__search="global")
    guide = plan(alone, certify=False)
    distribution = evaluate(alone, "leader-feedback", guide=guide, aggregation_tol=0.0)
    risk = followed(np.zeros((1, 2)), guide.velocities[:1])
    assert distribution.success[0] == pytest.approx(math.exp(-risk[0]), rel=1e-9)
    assert distribution.success[1] < plan(alone, gap=1e-3).survival_bound


# --- decisions


@pytest.mark.parametrize("name", NAMES)
def test_decision_far_from_plans_is_independent_of_batch_and_order(name: str) -> None:
    state, order = states(30, 2), [2, 0, 3, 1]
    whole = policy(name).decide(3, *state)
    for rows in (slice(0, 1), slice(7, 20)):
        part = policy(name).decide(3, *(each[rows] for each in state))
        np.testing.assert_array_equal(part.velocities, whole.velocities[rows])
        np.testing.assert_array_equal(part.infeasible, whole.infeasible[rows])
    turned = policy(name).velocities(3, *(each[:, order] for each in state))
    np.testing.assert_allclose(turned, whole.velocities[:, order], atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_lead_agent_is_alive_and_reaches_best_next_point(name: str) -> None:
    positions, previous_velocities, alive = states(200, 3)
    first, goals = policy(name).lead_agents(2, positions, previous_velocities, alive)
    rows = np.arange(len(first))
    assert alive[rows, first].all()
    risks = policy(name).best_steps(
        2, positions.reshape(-1, 2), previous_velocities.reshape(-1, 2)
    )[1]
    risks = np.where(alive, risks.reshape(alive.shape), np.inf)
    known = np.isfinite(risks).any(axis=1)
    assert known.mean() > 0.8
    least = risks.min(axis=1)[known]
    np.testing.assert_allclose(risks[rows, first][known], least, rtol=1e-8)
    decision = policy(name).decide(2, positions, previous_velocities, alive)
    reached = positions[rows, first] + DT * decision.velocities[rows, first]
    np.testing.assert_allclose(reached[known], goals[known], atol=1e-9)
    assert decision.failures.sum() == 0


def test_corridor_members_stay_near_lead_agent_or_count_infeasible() -> None:
    positions, previous_velocities, alive = states(200, 4)
    found = policy("constrained-feedback")
    first, goals = found.lead_agents(2, positions, previous_velocities, alive)
    decision = found.decide(2, positions, previous_velocities, alive)
    ends = positions + DT * decision.velocities
    away = np.hypot(*np.moveaxis(ends - goals[:, None], -1, 0))
    hard = PlanarSets(  # velocities within the limits, closest to the centre
        np.full(2, -2.0),
        np.full(2, 2.0),
        previous_velocities[..., None, :],
        np.full(1, math.sqrt(0.5)),
    )
    nearest = positions + DT * hard.project((goals[:, None] - positions) / DT)
    distance = np.hypot(*np.moveaxis(nearest - goals[:, None], -1, 0))
    able = alive & (distance < math.sqrt(0.05) * 0.999)
    assert able.sum() > len(able)
    assert (away[able] <= math.sqrt(0.05) * (1 + 1e-6)).all()
    others = alive & (np.arange(4) != first[:, None])
    unable = others & (distance > math.sqrt(0.05) * 1.001)
    assert (decision.infeasible >= unable.sum(axis=1)).all()
    np.testing.assert_allclose(away[unable], distance[unable], atol=1e-6)


# --- success


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_feedback_improves_success_of_dispersed_swarm(name: str) -> None:
    guide = plan(SCENARIO, certify=False)
    options = {"tolerance": 0.02, "aggregation_tol": 1e-6, "guide": guide}
    fixed = evaluate(SCENARIO, name, **options)
    feedback = evaluate(SCENARIO, f"{name}-feedback", **options)
    assert feedback.success[0] > fixed.success[1]
