"""The batched interior-point method: published optima, batches, and problems that are ill posed."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import STATEMENTS, published
from hypothesis import given, settings
from hypothesis import strategies as st

from casswarm.optimization.problem import Instances, Nlp
from casswarm.optimization.solution import Status
from casswarm.optimization.solvers import FilterInteriorPoint, Ipopt
from casswarm.optimization.solvers.interior_point.compiled_problems import (
    numeric_problems,
    program_tapes,
)
from casswarm.optimization.solvers.interior_point.engine import minimise
from casswarm.optimization.solvers.interior_point.iterates import Options

SOLVER = FilterInteriorPoint()
NO_MULTIPLIERS = 13
"""The problem whose minimum has none, so that no method reaches it to a tolerance."""


@pytest.mark.parametrize("number", sorted({*STATEMENTS, 1, 6, 7, 21, 35, 71}))
def test_published_optimum_is_found(number: int) -> None:
    known = published(number)
    (solution,) = SOLVER.solve(known.nlp, known.instance)
    optima = np.array([known.objective, *known.local])
    assert solution.status is Status.SOLVED
    close = abs(solution.objective - optima) <= 1e-5 * np.maximum(1.0, abs(optima))
    assert close.any()
    assert solution.residuals.violation <= 1e-7
    if number != NO_MULTIPLIERS:
        assert solution.residuals.stationarity <= 1e-5
        assert solution.residuals.complementarity <= 1e-5


def valley() -> Nlp:
    """Rosenbrock's function with parameters, in a disc, above a parabola."""
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    objective = (x[0] - p[0]) ** 2 + 10 * (x[1] - p[1] * x[0] ** 2) ** 2
    rows = {"disc": ca.sumsqr(x), "above": x[1] - x[0] ** 2}
    return Nlp("valley", {"x": x}, {"p": p}, objective, rows)


VALLEY = valley()


def instances(seed: int, count: int) -> Instances:
    rng = np.random.default_rng(seed)
    return Instances(
        x0=rng.uniform(-1, 1, (count, 2)),
        p=rng.uniform(0.5, 2.0, (count, 2)),
        lbx=np.array([[-1.5, -np.inf]]),
        ubx=np.array([[1.5, np.inf]]),
        lbg=np.array([[-np.inf, -0.5]]),
        ubg=np.array([[1.0, np.inf]]),
    )


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6))
def test_answers_do_not_depend_on_the_rest_of_the_batch(seed: int, count: int) -> None:
    batch = instances(seed, count)
    together = SOLVER.solve(VALLEY, batch)
    for row in range(count):
        (alone,) = SOLVER.solve(VALLEY, batch[row : row + 1])
        assert (alone.x == together[row].x).all()
        assert alone.iterations == together[row].iterations


def test_answers_do_not_depend_on_how_many_advance_together() -> None:
    batch, options = instances(7, 40), Options(1e-8, 1e-8, 0.1, 0.01, 100)
    problems = numeric_problems(VALLEY, batch.p)
    few, many = (minimise(problems, batch, options, width) for width in (3, 40))
    assert (few.x == many.x).all()
    assert (few.iterations == many.iterations).all()
    assert few.message == many.message


@pytest.mark.parametrize("number", [15, 39, 71])
def test_batch_is_verified_and_the_rest_goes_to_the_fallback(number: int) -> None:
    known = published(number)
    x0 = known.instance.x0 + np.linspace(-0.2, 0.2, 9)[:, None]
    one = known.instance
    batch = Instances(x0, one.p, one.lbx, one.ubx, one.lbg, one.ubg)
    alone = SOLVER.solve_batch(known.nlp, batch)
    solver = FilterInteriorPoint(fallback=Ipopt())
    helped = solver.solve_batch(known.nlp, batch)
    assert helped.success.all()
    assert (helped.used_fallback == ~alone.success).all()
    for row, solution in enumerate(SOLVER.solve(known.nlp, batch)):
        assert alone.success[row] == solution.status.success
        assert alone.objective[row] == pytest.approx(solution.objective, rel=1e-12)
        assert alone.violation[row] == pytest.approx(solution.residuals.violation, abs=1e-12)
        if alone.success[row]:
            largest = max(solution.residuals.stationarity, solution.residuals.complementarity)
            assert alone.stationarity[row] == pytest.approx(largest, rel=1e-6, abs=1e-10)
    used = [solution.message.startswith("by ipopt") for solution in solver.solve(known.nlp, batch)]
    assert used == helped.used_fallback.tolist()


def test_operations_that_are_not_scalar_are_evaluated_by_casadi() -> None:
    grid = np.linspace(-3.0, 3.0, 31)
    table = ca.interpolant("table", "bspline", [grid], (grid - 1) ** 2)
    nlp, batch = parabola(table, lbx=-2.0, ubx=2.0)
    assert program_tapes(nlp) is None
    (solution,) = SOLVER.solve(nlp, batch)
    assert solution.status is Status.SOLVED
    assert solution.x[0] == pytest.approx(1.0, abs=1e-6)


def test_batch_agrees_with_ipopt() -> None:
    batch = instances(3, 50)
    objectives = [
        np.array([solution.objective for solution in solver.solve(VALLEY, batch)])
        for solver in (SOLVER, Ipopt())
    ]
    # problems with two minima may end in either
    assert (abs(objectives[0] - objectives[1]) <= 1e-6).mean() >= 0.9


def test_fixed_variables_and_equal_bounds_are_kept() -> None:
    x = ca.MX.sym("x", 3)
    nlp = Nlp("fixed", {"x": x}, {}, ca.sumsqr(x - 2), {"sum": x[0] + x[1] + x[2]})
    fixed = Instances(
        x0=np.zeros((1, 3)),
        p=np.empty((1, 0)),
        lbx=np.array([[0.5, -5.0, -5.0]]),
        ubx=np.array([[0.5, 5.0, 5.0]]),
        lbg=np.array([[2.0]]),
        ubg=np.array([[2.0]]),
    )
    (solution,) = SOLVER.solve(nlp, fixed)
    assert solution.status is Status.SOLVED
    np.testing.assert_allclose(solution.x, [0.5, 0.75, 0.75], atol=1e-7)


def parabola(objective: Any = None, **bounds: float) -> tuple[Nlp, Instances]:
    x = ca.MX.sym("x")
    nlp = Nlp("parabola", {"x": x}, {}, x**2 if objective is None else objective(x), {"g": x})
    values = {"lbx": -np.inf, "ubx": np.inf, "lbg": -np.inf, "ubg": np.inf} | bounds
    arrays = {name: np.array([[value]]) for name, value in values.items()}
    return nlp, Instances(x0=np.array([[3.0]]), p=np.empty((1, 0)), **arrays)


def test_contradicting_bounds_are_no_success() -> None:
    (solution,) = SOLVER.solve(*parabola(ubx=-1.0, lbg=1.0))
    assert not solution.status.success


def test_objective_that_is_not_finite_is_no_success() -> None:
    (solution,) = SOLVER.solve(*parabola(lambda x: ca.sqrt(x - 10), ubx=5.0))
    assert solution.status is Status.FAILED
    assert "not finite" in solution.message


def test_iteration_limit_is_reported() -> None:
    known = published(1)
    (solution,) = FilterInteriorPoint(max_iter=2).solve(known.nlp, known.instance)
    assert solution.status is Status.ITERATION_LIMIT
    assert solution.iterations == 2


def test_problem_without_bounds_is_solved() -> None:
    (solution,) = SOLVER.solve(*parabola())
    assert solution.status is Status.SOLVED
    assert abs(solution.x[0]) <= 1e-7
