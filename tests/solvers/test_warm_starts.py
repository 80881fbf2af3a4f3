"""Multipliers and iterations of batch solutions, and starts from multipliers."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import published
from known_problems import INF
from window_cases import leaders_of, window

from casswarm.errors import SolverError
from casswarm.formation import Auto, Formation, leader_mpc_formation
from casswarm.nlp import BatchSolution, Instances, Nlp
from casswarm.nlp.residuals import kkt_residuals
from casswarm.solvers import FilterInteriorPoint, Ipopt, Minimize, Solver

SOLVER = FilterInteriorPoint()


def neighbours(batch: int) -> list[Formation]:
    """Windows of model predictive control, and those of states nearby."""
    data = window(batch, 3, 3, 0, deaths=0.0)
    noise = 3e-3 * np.random.default_rng(0).normal(size=data.positions.shape)
    others = replace(data, positions=data.positions + noise)
    return [leader_mpc_formation(each, leaders_of(each)) for each in (data, others)]


@pytest.fixture(scope="module")
def hs_71() -> tuple[Nlp, Instances]:
    """Problem 71 with parameters, three instances."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 2)
    objective = x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
    rows = ca.vertcat(x[0] * x[1] * x[2] * x[3] - p[0], ca.sumsqr(x) - p[1])
    instances = Instances(
        x0=np.tile([1.0, 5.0, 5.0, 1.0], (3, 1)),
        p=np.array([[25.0, 40.0], [26.0, 41.0], [22.0, 44.0]]),
        lbx=np.ones(4),
        ubx=np.full(4, 5.0),
        lbg=np.zeros(2),
        ubg=np.array([INF, 0.0]),
    )
    return Nlp.from_expressions("hs71", x, p, objective, rows), instances


def restart(solver: Solver, problem: tuple[Nlp, Instances], found: BatchSolution) -> BatchSolution:
    nlp, instances = problem
    return solver.solve_batch(nlp, instances.with_x0(found.x, found.lam_x, found.lam_g))


# --- multipliers of solutions


@pytest.mark.parametrize("solver", [SOLVER, Ipopt()], ids=lambda solver: solver.name)
def test_multipliers_and_iterations_are_those_of_single_solves(
    solver: Solver, hs_71: tuple[Nlp, Instances]
) -> None:
    nlp, instances = hs_71
    batch = solver.solve_batch(nlp, instances)
    for i, solution in enumerate(solver.solve(nlp, instances)):
        given = batch.lam_x[i], batch.lam_g[i]
        residuals = kkt_residuals(nlp, instances[i : i + 1], batch.x[i], given)
        assert max(residuals.stationarity, residuals.complementarity) <= 1e-6
        assert batch.iterations[i] == solution.iterations > 0
    assert (batch.lam_x[0] < -0.1).any()  # at a lower bound, as CasADi's


def test_solvers_without_multipliers_have_none() -> None:
    case = published(1)
    batch = Minimize(_unused).solve_batch(case.nlp, case.instance)
    assert batch.lam_x.shape == (1, 2)
    assert np.isnan(batch.lam_x).all()
    nlp, instances = (formation := neighbours(2)[0]).nlp, formation.instances
    batch = Auto().solve_batch(nlp, instances)
    assert batch.lam_x.shape == instances.x0.shape
    assert batch.lam_g.shape == instances.lbg.shape
    assert np.isnan(batch.lam_g).all()
    assert (batch.iterations > 0).all()


def _unused(*_: object, **__: object) -> object:
    raise ArithmeticError("no answer")


def test_batch_solution_pickles_with_multipliers_and_shows_iterations(
    hs_71: tuple[Nlp, Instances],
) -> None:
    batch = SOLVER.solve_batch(*hs_71)
    copied = pickle.loads(pickle.dumps(batch))
    for part in fields(batch):
        np.testing.assert_array_equal(getattr(copied, part.name), getattr(batch, part.name))
    assert f"iterations<={batch.iterations.max()}, x of shape (3, 4)" in repr(batch)


# --- starts from multipliers


@pytest.mark.parametrize("solver", [SOLVER, Ipopt()], ids=lambda solver: solver.name)
def test_warm_start_of_windows_needs_less_than_half_of_the_iterations(solver: Solver) -> None:
    before, after = ((each.nlp, each.instances) for each in neighbours(6))
    found, cold = solver.solve_batch(*before), solver.solve_batch(*after)
    warm = restart(solver, after, found)
    near = solver.solve_batch(after[0], after[1].with_x0(found.x))
    assert warm.success.all()
    np.testing.assert_allclose(warm.objective, cold.objective, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-3)
    assert 2 * warm.iterations.sum() < min(cold.iterations.sum(), near.iterations.sum())


@pytest.mark.parametrize("number", [12, 35, 43, 71, 76, 100])
def test_warm_start_near_a_published_optimum(number: int) -> None:
    case = published(number)
    found = SOLVER.solve_batch(case.nlp, case.instance)
    noise = 1e-3 * np.random.default_rng(number).normal(size=(8, found.x.shape[1]))
    rows = np.zeros(8, int)
    moved = replace(found, **{name: getattr(found, name)[rows] for name in ("lam_x", "lam_g")})
    moved = replace(moved, x=found.x + noise)
    instances = case.instance[rows]
    warm = restart(SOLVER, (case.nlp, instances), moved)
    cold = SOLVER.solve_batch(case.nlp, instances.with_x0(moved.x))
    assert warm.success.all()
    np.testing.assert_allclose(warm.objective, found.objective[0], rtol=1e-6, atol=1e-6)
    assert warm.iterations.sum() < 0.8 * cold.iterations.sum()


def test_solution_is_its_own_warm_start(hs_71: tuple[Nlp, Instances]) -> None:
    nlp, instances = hs_71
    found = SOLVER.solve_batch(nlp, instances)
    again = restart(SOLVER, hs_71, found)
    assert again.iterations.max() <= 1
    np.testing.assert_allclose(again.x, found.x, atol=1e-7)
    scaled = replace(instances, scale=np.array([[10.0, 1e3]]))
    assert restart(SOLVER, (nlp, scaled), found).iterations.max() <= 1


def test_instances_without_multipliers_start_cold_and_none_depends_on_others(
    hs_71: tuple[Nlp, Instances],
) -> None:
    nlp, instances = hs_71
    cold = SOLVER.solve_batch(nlp, instances)
    lam_x = cold.lam_x.copy()
    lam_x[1, 2] = np.nan
    posed = instances.with_x0(instances.x0, lam_x, cold.lam_g)
    mixed = SOLVER.solve_batch(nlp, posed)
    np.testing.assert_array_equal(mixed.x[1], cold.x[1])
    for i in range(3):
        alone = SOLVER.solve_batch(nlp, posed[i : i + 1])
        np.testing.assert_array_equal(alone.x[0], mixed.x[i])
    assert (mixed.iterations != cold.iterations)[[0, 2]].any()


def test_useless_multipliers_lead_to_the_same_optimum(hs_71: tuple[Nlp, Instances]) -> None:
    nlp, instances = hs_71
    cold = SOLVER.solve_batch(nlp, instances)
    for size in (0.0, 1e3, -1e3):
        lam_x, lam_g = np.full_like(cold.lam_x, size), np.full_like(cold.lam_g, -size)
        warm = SOLVER.solve_batch(nlp, instances.with_x0(instances.x0, lam_x, lam_g))
        np.testing.assert_allclose(warm.objective, cold.objective, rtol=1e-6)


def test_multipliers_of_instances_are_checked(hs_71: tuple[Nlp, Instances]) -> None:
    nlp, instances = hs_71
    lam_x, lam_g = np.zeros((3, 4)), np.zeros((3, 2))
    with pytest.raises(SolverError, match="lam_g0 of the instances is missing; give both"):
        replace(instances, lam_x0=lam_x)
    with pytest.raises(SolverError, match=r"lam_x0 of the instances has shape \(2, 4\)"):
        instances.with_x0(instances.x0, lam_x[:2], lam_g)
    wrong = instances.with_x0(instances.x0, lam_x, lam_g[:, :1])
    for solver in (SOLVER, Ipopt()):
        with pytest.raises(SolverError, match=r"lam_g0 .* has shape \(3, 1\); expected: \(3, 2\)"):
            solver.solve_batch(nlp, wrong)
    copied = pickle.loads(pickle.dumps(instances.with_x0(instances.x0, lam_x, lam_g)))
    np.testing.assert_array_equal(copied[1:].lam_g0, lam_g[1:])
    assert instances.with_x0(instances.x0, lam_x, lam_g).with_x0(instances.x0).lam_x0 is None
