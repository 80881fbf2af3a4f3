"""Formations over several steps: the program and its solver, limits, one step, success."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear
from small_scenarios import Array, rate_by_hand
from window_cases import (
    COLLIDING,
    DT,
    GOAL,
    HAZARD,
    MOTION,
    RADARS,
    RHO,
    both,
    leaders_of,
    window,
)

import casswarm as csw
from casswarm import make_solver
from casswarm.formation import (
    Formation,
    InteriorPoint,
    corridor_formation,
    corridor_mpc_formation,
    leader_formation,
    leader_mpc_formation,
)
from casswarm.formation.horizon import MARGIN, nearest_trajectories, path_limits
from casswarm.motion import Motion, Step
from casswarm.nlp import Instances, Nlp, kkt_residuals
from casswarm.policies import applied_decision, make_policy
from casswarm.solvers import FilterInteriorPoint

AUTO = make_solver("auto")


# --- the program


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("corridor", [False, True])
def test_mpc_program_equals_written_out_formulas(corridor: bool, steps: int) -> None:
    data = window(1, 3, steps, seed=3)
    problem = both(data)[corridor]
    u = np.random.default_rng(4).normal(size=(steps, 3, 2))
    f, g = (
        np.asarray(part).ravel() for part in problem.nlp.evaluate(u.ravel(), problem.instances.p[0])
    )
    counted = np.flatnonzero(data.alive[0]) if corridor else leaders_of(data)
    places = data.positions[0] + DT * u
    rates = [
        rate_by_hand(i, places[s], data.alive[0], RADARS) for s in range(steps) for i in counted
    ]
    assert f[0] == pytest.approx(sum(rates), rel=1e-12)
    v = np.diff(u, axis=0, prepend=np.zeros((1, 3, 2)))
    w = np.diff(v, axis=0, prepend=data.previous_velocities[:1])
    v_max = data.motion.v_max
    rows = [((w / v_max) ** 2).sum(axis=-1).ravel(), v[1:].ravel() / v_max]
    if corridor:
        offsets = (places - data.goals[:, None]) / (v_max * DT)
        rows.append((offsets**2).sum(axis=-1).ravel())
    np.testing.assert_allclose(g, np.concatenate(rows), rtol=1e-12)


# --- known answers


def stopping(steps: int) -> Step:
    """A leader at speed 1, one unit from a guide that stands still; |v' - v| <= 0.5, dt = 1."""
    motion = Motion(v_max=2.0, a_max=0.25, dt=1.0)
    goals = np.tile([1.0, 0.0], (steps, 1))
    previous_velocities = np.array([[[1.0, 0.0]]])
    return Step(
        HAZARD, motion, np.zeros((1, 1, 2)), previous_velocities, np.ones((1, 1), bool), goals
    )


def test_leader_too_fast_for_guide_brakes_in_time() -> None:
    """One step ahead it flies there, cannot stop, and is 0.5 beyond. In view of three steps the
    squares (1 - x)^2 + (1.5 - 2x)^2 + 0 of its lags are least at x = 0.8: lags 0.2, -0.1, 0.
    """
    lags = {}
    for steps in (1, 3):
        data, worst = stopping(steps), []
        for _ in range(4):
            v = applied_decision(
                data, leader_mpc_formation(data, np.zeros(1, int)), AUTO
            ).velocities
            data = replace(data, positions=data.positions + v, previous_velocities=v)
            worst.append(1.0 - data.positions[0, 0, 0])
        lags[steps] = worst
    np.testing.assert_allclose(lags[1], [0, -0.5, -0.5, 0], atol=1e-6)
    np.testing.assert_allclose(lags[3], [0.2, -0.1, 0, 0], atol=1e-5)


@pytest.mark.parametrize("steps", [2, 5, 8])
def test_nearest_trajectories_on_line_equal_least_squares(steps: int) -> None:
    """On a line the discs of a_max are intervals of the changes of velocity: a convex QP."""
    rng = np.random.default_rng(5)
    data = window(1, 1, steps, seed=6)
    limits = replace(path_limits(data), speed=50.0)  # out of reach
    before = np.stack([rng.normal(0, 1, 30), np.zeros(30)], axis=1)
    goals = np.cumsum(rng.normal(0, 2, (30, steps)), axis=1)
    paths, failed = nearest_trajectories(
        limits, before, np.stack([goals, 0 * goals], axis=-1), np.zeros(steps)
    )
    assert not failed.any()
    total = np.tril(np.ones((steps, steps)))
    for b in range(30):
        without = before[b, 0] * np.arange(1, steps + 1)
        exact = lsq_linear(
            total @ total, goals[b] - without, (-limits.change, limits.change), tol=1e-14
        )
        np.testing.assert_allclose(paths[b, :, 0], without + total @ total @ exact.x, atol=2e-6)
    assert np.abs(paths[..., 1]).max() <= 1e-6


@pytest.mark.parametrize("radius", [0.0, 0.5])
def test_nearest_trajectories_equal_ipopt(radius: float) -> None:
    rng = np.random.default_rng(7)
    limits = path_limits(window(1, 1, 4, seed=0))
    before = rng.uniform(-1.9, 1.9, (12, 2))
    goals = np.cumsum(before[:, None] + rng.normal(0, 0.8, (12, 4, 2)), axis=1)
    goals += rng.normal(0, 0.7, (12, 1, 2))
    paths, failed = nearest_trajectories(limits, before, goals, np.full(4, radius))
    assert not failed.any()
    for b in range(12):
        exact = _nearest_by_ipopt(before[b], goals[b], radius, limits.speed, limits.change)
        out = np.maximum(0.0, np.hypot(*(paths[b] - goals[b]).T) - radius)
        assert (out**2).sum() == pytest.approx(exact, abs=2e-6)


def _nearest_by_ipopt(
    before: Array, goals: Array, radius: float, speed: float, change: float
) -> float:
    """Least sum of squared distances to discs, by Opti with slack variables."""
    opti = ca.Opti()
    u, out = opti.variable(2, 4), opti.variable(4)
    velocity, place = before, ca.MX.zeros(2)
    for s in range(4):
        v = u[:, s] - place
        opti.subject_to(opti.bounded(-speed, v, speed))
        opti.subject_to(ca.sumsqr(v - velocity) <= change**2)
        opti.subject_to(ca.sumsqr(u[:, s] - goals[s]) <= (radius + out[s]) ** 2)
        velocity, place = v, u[:, s]
    opti.subject_to(out >= 0)
    opti.set_initial(out, 5.0)
    opti.minimize(ca.sumsqr(out))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-9})
    return float(opti.solve().value(ca.sumsqr(out)))


# --- against Ipopt, and the judge


def posed(data: Step) -> list[tuple[Nlp, Instances]]:
    """Both problems of the states in which some member is free."""
    return [(each.nlp, each.instances[each.free.any(axis=1)]) for each in both(data)]


@pytest.mark.parametrize("steps", [2, 3, 5])
def test_interior_point_is_no_worse_than_ipopt(steps: int) -> None:
    data = window(12, 4, steps, seed=8)
    for nlp, instances in posed(data):
        batch = InteriorPoint().solve_batch(nlp, instances)
        ipopt = make_solver("ipopt").solve(nlp, instances)
        assert batch.success.all()
        solved = [solution.status.success for solution in ipopt]
        assert sum(solved) >= len(instances) - 2
        exact = np.array([s.objective if s.status.success else np.inf for s in ipopt])
        assert (batch.objective <= exact * (1 + 1e-6) + 1e-9).all()


@pytest.mark.slow
def test_interior_point_with_collisions_is_mostly_better() -> None:
    """Local minima abound; the batch solver has several starts, Ipopt the one."""
    data = replace(window(16, 4, 3, seed=9, deaths=0.1), hazard=COLLIDING)
    worse, better = 0, 0
    for nlp, instances in posed(data):
        batch = AUTO.solve_batch(nlp, instances)
        ipopt = make_solver("ipopt").solve(nlp, instances)
        exact = np.array([s.objective if s.status.success else np.inf for s in ipopt])
        worse += int((batch.objective > exact * (1 + 1e-6)).sum())
        better += int((batch.objective < exact * (1 - 1e-6)).sum())
    assert worse <= 6 < better


def test_interior_point_residuals_equal_kkt_residuals() -> None:
    data = window(8, 4, 3, seed=10)
    for nlp, instances in posed(data):
        run = InteriorPoint().run_batch(nlp, instances)
        for i, answer in enumerate(run.answers()):
            found = kkt_residuals(nlp, instances[i : i + 1], answer.x, answer.multipliers)
            assert found.violation <= 1e-12
            unit = instances.scale[i, 1] / instances.scale[i, 0]
            assert found.stationarity <= unit * run.results.verified[i, 2] + 1e-9
            assert found.complementarity <= 1e-6
            low, high = answer.multipliers  # type: ignore[misc]
            estimated = kkt_residuals(nlp, instances[i : i + 1], answer.x)
            assert estimated.stationarity <= 1e-3
            assert (high[: 3 * 4] >= 0).all()
            assert np.isfinite(low).all()


def paths_of(problem: Formation, data: Step) -> Array:
    """Displacements (B, H, n, 2) by the batch solver, all converged; prescribed ones unchanged."""
    batch, n = data.alive.shape
    rows = np.flatnonzero(problem.free.any(axis=1))
    found = problem.instances.x0.copy()
    run = InteriorPoint().run_batch(problem.nlp, problem.instances[rows])
    assert run.results.verified[:, 2].max(initial=0.0) <= 1e-6
    found[rows] = run.results.x
    return found.reshape(batch, data.horizon, n, 2)


# --- a horizon of one step


@pytest.mark.parametrize("solver", [InteriorPoint(), AUTO])
def test_empty_batch_of_horizons_has_empty_answer(solver: csw.Solver) -> None:
    formation = leader_mpc_formation(data := window(2, 3, 3, seed=5), leaders_of(data))
    found = solver.solve_batch(formation.nlp, formation.instances[:0])
    assert found.x.shape == (0, formation.instances.x0.shape[1])
    assert found.success.shape == (0,)


@pytest.mark.parametrize("name", ["leader", "constrained"])
def test_horizon_of_one_step_equals_one_step_policy(name: str) -> None:
    scenario = csw.load_scenario("paper-1")
    guide = csw.plan(scenario, certify=False)
    paper = make_policy(name, scenario, guide)
    assert type(make_policy(name, scenario, guide, horizon=1)) is type(paper)
    assert type(make_policy(f"{name}-mpc-1", scenario, guide)) is type(paper)
    mpc = replace(make_policy(name, scenario, guide, horizon=4), horizon=1)  # type: ignore[type-var]
    last = make_policy(name, scenario, guide, horizon=4)
    rng = np.random.default_rng(1)
    for step, policies in ((0, [mpc]), (9, [mpc]), (guide.arrival - 1, [mpc, last])):
        alive = rng.random((6, 5)) > 0.3
        alive[:, 0] = True
        X = (guide.reference(step) + rng.normal(0, 0.2, (6, 5, 2))) * alive[..., None]
        before = rng.uniform(-1.5, 1.5, (6, 5, 2)) * alive[..., None]
        expected = paper.decide(step, X, before, alive)
        for policy in policies:
            found = policy.decide(step, X, before, alive)
            np.testing.assert_array_equal(found.velocities, expected.velocities)
            np.testing.assert_array_equal(found.infeasible, expected.infeasible)


def test_mpc_formation_of_one_step_matches_spg_solution() -> None:
    data = window(40, 4, 1, seed=2)
    leaders = leaders_of(data)
    pairs = ((leader_formation(data, leaders), 0.0), (corridor_formation(data, RHO), MARGIN))
    for mpc, (one, margin) in zip(both(data), pairs, strict=True):
        found, paper = (
            applied_decision(data, mpc, InteriorPoint()),
            one.instances.lbx.reshape(40, 4, 2).copy(),
        )
        rows = np.flatnonzero(one.free.any(axis=1))
        solution = make_solver("spectral").solve_batch(one.nlp, one.instances[rows])
        assert solution.success.all()
        paper[rows] = solution.x.reshape(-1, 4, 2)
        assert not found.failures.any()
        np.testing.assert_array_equal(found.infeasible, one.infeasible.sum(axis=1))
        # members outside the corridor have the slack of the margin, which moves the others slightly
        calm = ~one.infeasible.any(axis=1, keepdims=True) | (margin == 0.0)
        met = data.alive & calm
        np.testing.assert_allclose(found.velocities[met], paper[met], atol=2e-4)
        reached = data.positions + DT * found.velocities, data.positions + DT * paper
        far, near = (np.hypot(*(position - GOAL).transpose(2, 0, 1)) for position in reached)
        lost = data.alive & one.infeasible
        assert (far[lost] <= near[lost] + margin * math.sqrt(RHO) + 1e-6).all()


# --- limits and counts


@pytest.mark.parametrize("steps", [2, 4])
def test_limits_hold_along_path_and_in_applied_velocities(steps: int) -> None:
    data = window(30, 4, steps, seed=11, spread=0.6)
    for problem in both(data):
        rows = problem.free.any(axis=1)
        v = np.diff(paths_of(problem, data)[rows], axis=1, prepend=0.0)
        assert np.abs(v).max() <= MOTION.v_max + 1e-9
        before = np.concatenate([data.previous_velocities[rows][:, None], v], axis=1)
        turns = (np.diff(before, axis=1) ** 2).sum(axis=-1)
        assert turns.max() <= MOTION.a_max + 1e-9
        decision = applied_decision(data, problem, AUTO)
        assert not decision.failures.any()
        first = decision.velocities
        assert np.abs(first).max() <= MOTION.v_max
        turns = ((first - data.previous_velocities) ** 2).sum(axis=-1)
        assert turns[data.alive].max() <= MOTION.a_max + 1e-9
        assert (first[~data.alive] == 0).all()


def test_sets_of_paths_contain_what_is_within_their_limits() -> None:
    data = window(20, 4, 3, seed=5)
    for problem in both(data):
        sets, free = problem.instances.feasible_set, problem.free
        assert sets is not None
        paths = paths_of(problem, data)
        assert sets.contains(paths, 1e-7)[free].all()
        far = paths + np.array([2.1 * MOTION.v_max, 0.0]) * np.arange(1, 4)[:, None, None]
        assert not sets.contains(far, 1e-7)[free].any()
        shifted = paths + np.array([0.0, 10.0])
        assert not sets[:5].contains(shifted[:5], 1e-7)[free[:5]].any()


def test_infeasible_counts_members_that_miss_next_soft_constraint() -> None:
    data = window(40, 4, 3, seed=12)
    led, kept = both(data)
    for problem, constrained, radius in (
        (led, np.arange(4) == leaders_of(data)[:, None], 0.0),
        (kept, data.alive, math.sqrt(RHO)),
    ):
        decision = applied_decision(data, problem, AUTO)
        away = data.positions + DT * decision.velocities - data.goals[0]
        missed = np.hypot(away[..., 0], away[..., 1]) > radius + 1e-6 * MOTION.v_max * DT
        np.testing.assert_array_equal(decision.infeasible, (missed & constrained).sum(axis=1))
        assert 0 < decision.infeasible.sum() < constrained.sum()


def test_mpc_of_single_member_is_feasible() -> None:
    data = window(5, 1, 3, seed=17, deaths=0.0)
    for problem in both(data):
        velocities = applied_decision(data, problem, AUTO).velocities
        assert np.isfinite(velocities).all()
        assert np.abs(velocities).max() <= MOTION.v_max


def test_corridor_once_feasible_stays_feasible_in_next_horizon() -> None:
    """Members that have met every corridor continue to do so in closed loop."""
    data = window(20, 3, 4, seed=18, spread=0.05, deaths=0.0)
    met = np.ones(20, bool)
    pace = 1.4 * np.stack([np.cos(0.25 * np.arange(12)), np.sin(0.25 * np.arange(12))], axis=1)
    path = GOAL + DT * np.concatenate([np.zeros((1, 2)), np.cumsum(pace[1:], axis=0)])
    short = []
    for t in range(8):
        now = replace(data, goals=path[t : t + 4])
        decision = applied_decision(now, corridor_mpc_formation(now, RHO), AUTO)
        X = data.positions + DT * decision.velocities
        data = replace(data, positions=X, previous_velocities=decision.velocities)
        short.append(decision.infeasible)
        met &= decision.infeasible == 0
    assert met.sum() >= 10
    assert sum(short[4:]).sum() == 0


def test_corridor_is_no_long_way_for_the_generic_method() -> None:
    """With a single second-order correction of a step, it took 216 iterations along the curve."""
    formation = corridor_mpc_formation(window(1000, 5, 3, 0), RHO)
    solution = FilterInteriorPoint().solve_batch(formation.nlp, formation.instances[177:178])
    assert solution.success[0]
    assert solution.iterations[0] < 60
