"""Formation problems: closed forms, brute force, invariances, infeasible soft constraints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from small_scenarios import Array, rate_by_hand
from window_cases import DT, GOAL, HAZARD, MOTION, RADARS, RHO, leaders_of

from casswarm import SaturationCollision, Status, load_scenario, make_solver
from casswarm.formation import Formation, corridor_formation, leader_formation
from casswarm.motion import Step
from casswarm.problems import formation_nlp

EXACT = ["ipopt", "auto"]


def swarm(batch: int, n: int, seed: int, spread: float = 0.35, deaths: float = 0.3) -> Step:
    """States of members that move in any direction to the goal, some of them destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, n)) >= deaths
    alive[:, 0] |= ~alive.any(axis=1)
    before = rng.uniform(-1.9, 1.9, (batch, n, 2))
    positions = GOAL - DT * before + rng.normal(0, spread, (batch, n, 2))
    living = alive[..., None]
    return Step(HAZARD, MOTION, positions * living, before * living, alive, GOAL[None])


def velocities(formation: Formation, solver: str = "ipopt") -> Array:
    """Solutions (B, n, 2) of problems, which must all be solved."""
    found = formation.instances.lbx.reshape(*formation.free.shape, 2).copy()
    rows = np.flatnonzero(formation.free.any(axis=1))
    solutions = make_solver(solver).solve(formation.nlp, formation.instances[rows])
    assert {solution.status for solution in solutions} <= {Status.SOLVED}
    found[rows] = [solution.x.reshape(-1, 2) for solution in solutions]
    return found


def both(step: Step, leaders: NDArray[np.intp], rho: float = RHO) -> list[Formation]:
    return [leader_formation(step, leaders), corridor_formation(step, rho)]


def nearest_allowed(target: Array, previous_velocities: Array) -> Array:
    """Projection on the box and the disc of a_max, by Dykstra's alternating algorithm."""
    x, corrections = target.copy(), np.zeros((2, 2))
    for _ in range(1000):
        for k in range(2):
            y = x + corrections[k]
            offset = y - previous_velocities
            shrink = min(1.0, math.sqrt(0.5) / max(math.hypot(*offset), 1e-300))
            x = np.clip(y, -2, 2) if k == 0 else previous_velocities + shrink * offset
            corrections[k] = y - x
    return x


def allowed(previous_velocities: Array, position: Array | None = None, cells: int = 60) -> Array:
    """Many velocities (m, 2) within the limits and, given a position, in the corridor."""
    radius = math.sqrt(0.5) * np.linspace(0, 1, cells)
    angle = np.linspace(0, 2 * math.pi, 3 * cells)
    disc = previous_velocities + np.multiply.outer(
        radius, np.stack([np.cos(angle), np.sin(angle)], 1)
    )
    points = np.clip(disc.reshape(-1, 2), -2, 2)
    points = points[((points - previous_velocities) ** 2).sum(axis=1) <= 0.5]
    if position is None:
        return points
    return points[((position + DT * points - GOAL) ** 2).sum(axis=1) <= RHO]


# --- the nonlinear program


def test_formation_nlp_matches_formulas_by_hand() -> None:
    step = swarm(1, 4, seed=0)
    nlp = formation_nlp(HAZARD, 4, corridor=True)
    weights, v = np.array([1.0, 0.0, 0.5, 1.0]), np.random.default_rng(1).normal(size=(4, 2))
    X, previous_velocities = step.positions[0], step.previous_velocities[0]
    p = nlp.pack_parameters(
        positions=X,
        previous_velocities=previous_velocities,
        alive=step.alive[0, :, None],
        weights=weights[:, None],
        goal=GOAL[None],
        dt=[[DT]],
        v_max=[[2.0]],
    )
    objective, g = (np.asarray(part).ravel() for part in nlp.evaluate(v.ravel(), p[0]))
    following = X + DT * v
    rates = [rate_by_hand(i, following, step.alive[0], RADARS) for i in range(4)]
    # of the destroyed the formula is that of the living: the weights decide
    assert objective[0] == pytest.approx(sum(weights * rates), rel=1e-12)
    turns = ((v - previous_velocities) ** 2).sum(axis=1) / 2.0**2
    corridor = ((following - GOAL) ** 2).sum(axis=1) / (2.0 * DT) ** 2
    np.testing.assert_allclose(g, [*turns, *corridor], rtol=1e-12)


def test_objective_weighs_leader_or_all_living_members() -> None:
    step = swarm(6, 5, seed=2)
    leaders = leaders_of(step)
    v = np.random.default_rng(3).normal(size=(6, 5, 2))
    for formation, all_living in zip(both(step, leaders), (False, True), strict=True):
        for b in range(6):
            value = formation.nlp.evaluate(v[b].ravel(), formation.instances.p[b])[0]
            following = step.positions[b] + DT * v[b]
            counted = np.flatnonzero(step.alive[b]) if all_living else [leaders[b]]
            rates = [rate_by_hand(i, following, step.alive[b], RADARS) for i in counted]
            assert float(value) == pytest.approx(sum(rates), rel=1e-12)


# --- known answers


def test_toward_returns_nearest_allowed_velocity() -> None:
    step = swarm(10, 3, seed=4)
    found = MOTION.toward(step.positions, step.previous_velocities, GOAL)
    for index in np.ndindex(10, 3):
        target = (GOAL - step.positions[index]) / DT
        expected = nearest_allowed(target, step.previous_velocities[index])
        np.testing.assert_allclose(found[index], expected, atol=1e-7)


@pytest.mark.parametrize("solver", EXACT)
def test_followers_approach_leader_as_closely_as_allowed(
    solver: str,
) -> None:
    """In scenario I only distances between members matter, not the radars."""
    step = swarm(12, 4, seed=5)
    leaders = leaders_of(step)
    found = velocities(leader_formation(step, leaders), solver)
    for b, leader in enumerate(leaders):
        target = (GOAL - step.positions[b, leader]) / DT
        lead = nearest_allowed(target, step.previous_velocities[b, leader])
        np.testing.assert_allclose(found[b, leader], lead, atol=1e-7)
        position = step.positions[b, leader] + DT * lead
        for i in np.flatnonzero(step.alive[b]):
            target = (position - step.positions[b, i]) / DT
            expected = nearest_allowed(target, step.previous_velocities[b, i])
            np.testing.assert_allclose(found[b, i], expected, atol=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("solver", EXACT)
@pytest.mark.parametrize("n", [1, 2])
def test_corridor_solution_has_least_total_rate(n: int, solver: str) -> None:
    step = swarm(6, n, seed=6, spread=0.08, deaths=0)
    formation = corridor_formation(step, RHO)
    assert not formation.infeasible.any()
    found = velocities(formation, solver)
    for b in range(6):
        X, previous_velocities = step.positions[b], step.previous_velocities[b]
        sets = [
            allowed(previous_velocities[i], X[i], cells=200 if n == 1 else 18) for i in range(n)
        ]
        assert min(map(len, sets)) > 20
        pairs = np.stack(np.meshgrid(*[np.arange(len(s)) for s in sets], indexing="ij"), -1)
        many = np.stack([s[pairs[..., i].ravel()] for i, s in enumerate(sets)], axis=1)
        brute = HAZARD.rates(X + DT * many).sum(axis=1).min()
        least = HAZARD.rates(X + DT * found[b]).sum()
        assert least <= brute + 1e-7
        assert least == pytest.approx(brute, rel=2e-2)  # feasible, so not far below either


def test_projected_gradient_converges_to_ipopt_solution() -> None:
    step = swarm(8, 3, seed=7, spread=0.2)
    for formation in both(step, leaders_of(step)):
        nlp, instances = formation.nlp, formation.instances[formation.free.any(axis=1)]
        exact = make_solver("ipopt").solve(nlp, instances)
        paper = make_solver("projected-gradient", step=0.5).solve(nlp, instances)  # 0.05 is slow
        pairs = [(e, p) for e, p in zip(exact, paper, strict=True) if p.status is Status.SOLVED]
        assert len(pairs) >= 4
        for e, p in pairs:
            assert p.objective == pytest.approx(e.objective, rel=1e-6)
            np.testing.assert_allclose(p.x, e.x, atol=2e-3)


@pytest.mark.parametrize("hazard", ["saturation", "collision"])
def test_formation_of_fifty_members_is_solved(hazard: str) -> None:
    scenario = load_scenario("large-swarm")
    rates = scenario.hazard
    if hazard == "collision":
        rates = SaturationCollision(scenario.hazard_table.radars)
    X = scenario.positions[None]
    step = Step(
        rates, MOTION, X, np.full_like(X, 0.7), np.ones((1, 50), bool), np.full((1, 2), 0.25)
    )
    before = rates.rates(X + DT * step.previous_velocities)[0]
    led, kept = both(step, np.array([24]), rho=2.0)
    assert rates.rates(X + DT * velocities(led))[0, 24] < before[24]
    assert rates.rates(X + DT * velocities(kept))[0].sum() < before.sum()


# --- infeasible soft constraints


def test_member_outside_corridor_approaches_it_and_counts_infeasible() -> None:
    step = swarm(10, 3, seed=13, spread=0.3)
    formation = corridor_formation(step, RHO)
    found = velocities(formation)
    for index in np.ndindex(10, 3):
        if not step.alive[index]:
            continue
        X, previous_velocities, v = (
            step.positions[index],
            step.previous_velocities[index],
            found[index],
        )
        reachable = allowed(previous_velocities, cells=150)
        least = math.sqrt(((X + DT * reachable - GOAL) ** 2).sum(axis=1).min())
        distance = math.dist(X + DT * v, GOAL)
        assert np.abs(v).max() <= 2.0
        assert math.dist(v, previous_velocities) <= math.sqrt(0.5) + 1e-7
        if formation.infeasible[index]:
            assert least > math.sqrt(RHO) - 1e-9
            assert distance <= least + 1e-9
            assert math.dist(v, previous_velocities) <= math.sqrt(0.5) + 1e-9
        else:
            assert least <= math.sqrt(RHO) + 0.002  # as fine as the samples are
            assert distance <= math.sqrt(RHO) + 1e-7
    np.testing.assert_array_equal(formation.free, step.alive & ~formation.infeasible)
    assert 5 <= formation.infeasible[step.alive].sum() <= step.alive.sum() - 5


def test_leader_that_misses_goal_is_only_infeasible_member() -> None:
    step = swarm(20, 4, seed=14)
    leaders = leaders_of(step)
    formation = leader_formation(step, leaders)
    rows = np.arange(20)
    lead = formation.instances.lbx.reshape(20, 4, 2)[rows, leaders]
    missed = np.hypot(*(step.positions[rows, leaders] + DT * lead - GOAL).T)
    short = formation.infeasible[rows, leaders]
    assert (short == (missed > 1e-6)).all()
    assert short.any()
    assert not short.all()
    assert formation.infeasible.sum() == short.sum()
    assert not formation.free[rows, leaders].any()
