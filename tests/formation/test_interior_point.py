"""MPC formation problems and their solver: formulas, known answers, Ipopt, KKT residuals."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear
from small_scenarios import Array, rate_by_hand
from window_cases import COLLIDING, DT, HAZARD, RADARS, both, leaders_of, window

from casswarm import make_solver
from casswarm.formation import InteriorPoint, leader_mpc_formation
from casswarm.formation.horizon import nearest_trajectories, path_limits
from casswarm.motion import Motion, Step
from casswarm.nlp import Instances, Nlp, kkt_residuals
from casswarm.policies import applied_decision

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
                data, leader_mpc_formation(data, np.zeros(1, int)), make_solver("auto")
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


def test_interior_point_with_collisions_is_mostly_better() -> None:
    """Local minima abound; the batch solver has several starts, Ipopt the one."""
    data = replace(window(16, 4, 3, seed=9, deaths=0.1), hazard=COLLIDING)
    worse, better = 0, 0
    for nlp, instances in posed(data):
        batch = make_solver("auto").solve_batch(nlp, instances)
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
