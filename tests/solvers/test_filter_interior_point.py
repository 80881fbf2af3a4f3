"""The batched interior-point method: optima, batches, ill-posed problems, units, threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cart_pole import cart_poles
from hock_schittkowski import MORE, NUMBERS, published
from hypothesis import given, settings
from hypothesis import strategies as st
from known_problems import INF, instances
from threadpoolctl import threadpool_info

from casswarm._util.threads import one_blas_thread
from casswarm.nlp import Instances, Nlp, Status
from casswarm.solvers import FilterInteriorPoint, Ipopt
from casswarm.solvers.interior_point import derivatives, engine, iterates, tape

SOLVER = FilterInteriorPoint()
DEGENERATE = 13
"""The problem at whose minimum no multipliers exist, so that it is found but not verified."""
HIGH_ORDER = {46: 1e-5, 49: 1e-5}
"""Distance of objectives where the minimum is flat to the fourth order or more."""


@pytest.mark.parametrize("number", [n for n in (*NUMBERS, *MORE) if n != DEGENERATE])
def test_published_optimum_is_found(number: int) -> None:
    known = published(number)
    (solution,) = SOLVER.solve(known.nlp, known.instance)
    optima = np.array([known.objective, *known.local])
    digits = HIGH_ORDER.get(number, 1e-6 if number in MORE else 1e-5)
    assert solution.status.success, solution
    assert (abs(solution.objective - optima) <= digits * np.maximum(1.0, abs(optima))).any()
    assert solution.residuals.violation <= 1e-7
    if number in NUMBERS:
        assert solution.status is Status.SOLVED
        assert solution.residuals.stationarity <= 1e-5
        assert solution.residuals.complementarity <= 1e-5


def test_published_optimum_without_multipliers_is_found_and_said_to_have_none() -> None:
    known = published(DEGENERATE)
    (solution,) = SOLVER.solve(known.nlp, known.instance)
    assert abs(solution.objective - known.objective) <= 1e-5
    np.testing.assert_allclose(solution.x, [1.0, 0.0], atol=1e-5)
    assert solution.residuals.violation <= 1e-7
    assert not solution.status.success
    assert "no multipliers found" in solution.message
    assert solution.residuals.stationarity > 1.0


@pytest.mark.parametrize("number", MORE)
def test_batch_from_random_starts_is_solved_with_fallback(number: int) -> None:
    known = published(number)
    one, rng = known.instance, np.random.default_rng(number)
    x0 = one.x0 + 0.02 * rng.normal(size=(8, one.x0.shape[1])) * np.maximum(0.1, abs(one.x0))
    batch = one.with_x0(np.clip(x0, one.lbx, one.ubx))
    solution = FilterInteriorPoint(fallback=Ipopt()).solve_batch(known.nlp, batch)
    assert solution.success.all(), solution.messages
    assert solution.violation.max() <= 1e-6
    least = min(known.objective, *known.local) if known.local else known.objective
    assert solution.objective.min() >= least - 1e-5 * max(1.0, abs(least))


def valley() -> Nlp:
    """Rosenbrock's function with parameters, in a disc, above a parabola."""
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    objective = (x[0] - p[0]) ** 2 + 10 * (x[1] - p[1] * x[0] ** 2) ** 2
    rows = {"disc": ca.sumsqr(x), "above": x[1] - x[0] ** 2}
    return Nlp("valley", {"x": x}, {"p": p}, objective, rows)


VALLEY = valley()


def valleys(seed: int, count: int) -> Instances:
    rng = np.random.default_rng(seed)
    x0, p = rng.uniform(-1, 1, (count, 2)), rng.uniform(0.5, 2.0, (count, 2))
    return instances(x0, p, lbx=[-1.5, -INF], ubx=[1.5, INF], lbg=[-INF, -0.5], ubg=[1.0, INF])


@pytest.mark.slow
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6))
def test_answers_do_not_depend_on_the_rest_of_the_batch(seed: int, count: int) -> None:
    batch = valleys(seed, count)
    together = SOLVER.solve(VALLEY, batch)
    for row in range(count):
        (alone,) = SOLVER.solve(VALLEY, batch[row : row + 1])
        assert (alone.x == together[row].x).all()
        assert alone.iterations == together[row].iterations


def test_answers_do_not_depend_on_how_many_advance_together() -> None:
    batch = valleys(7, 40)
    options = iterates.Options(1e-8, 1e-8, 0.1, 0.01, 100, np.full(len(batch), np.inf))
    problems = derivatives.numeric_problems(VALLEY, batch.p)
    few, many = (engine.minimise(problems, batch, options, width) for width in (3, 40))
    assert (few.x == many.x).all()
    assert (few.iterations == many.iterations).all()
    assert few.message == many.message


@pytest.mark.parametrize("number", [15, 39, 71])
def test_batch_is_verified_and_the_rest_goes_to_the_fallback(number: int) -> None:
    known = published(number)
    batch = known.instance.with_x0(known.instance.x0 + np.linspace(-0.2, 0.2, 9)[:, None])
    plain = FilterInteriorPoint(constr_mult_init_max=0.0, restoration=False)
    alone = plain.solve_batch(known.nlp, batch)
    assert alone.success.all() == (number == 71)
    solver = replace(plain, fallback=Ipopt())
    helped = solver.solve_batch(known.nlp, batch)
    assert helped.success.all()
    assert (helped.used_fallback == ~alone.success).all()
    for row, solution in enumerate(plain.solve(known.nlp, batch)):
        assert alone.success[row] == solution.status.success
        assert alone.objective[row] == pytest.approx(solution.objective, rel=1e-12)
        assert alone.violation[row] == pytest.approx(solution.residuals.violation, abs=1e-12)
        if alone.success[row]:
            largest = max(solution.residuals.stationarity, solution.residuals.complementarity)
            assert alone.stationarity[row] == pytest.approx(largest, rel=1e-6, abs=1e-10)
    used = [solution.message.startswith("by ipopt") for solution in solver.solve(known.nlp, batch)]
    assert used == helped.used_fallback.tolist()


@pytest.mark.parametrize("number", [15, 18, 40])
def test_restoration_solves_what_the_line_search_cannot(number: int) -> None:
    known = published(number)
    one, rng = known.instance, np.random.default_rng(number)
    x0 = np.clip(one.x0 + 0.2 * rng.normal(size=(100, one.x0.shape[1])), one.lbx, one.ubx)
    batch = one.with_x0(x0)
    without = FilterInteriorPoint(constr_mult_init_max=0.0, restoration=False)
    stuck = np.flatnonzero(~without.solve_batch(known.nlp, batch).success)
    together = replace(without, restoration=True).solve_batch(known.nlp, batch)
    assert stuck.size > 0
    assert together.success.all()
    assert abs(together.objective - known.objective).min() <= 1e-6 * max(1, abs(known.objective))
    one_by_one = replace(without, restoration=True).solve(known.nlp, batch[stuck[:3]])
    assert (np.array([answer.x for answer in one_by_one]) == together.x[stuck[:3]]).all()


def test_more_active_rows_than_variables() -> None:
    known = published(30)  # x1 = 1 is a bound, and x1^2 + x2^2 >= 1 is active there
    one, rng = known.instance, np.random.default_rng(0)
    starts = one.with_x0(one.x0 + 1e-6 * rng.normal(size=(50, 3)))
    batch = SOLVER.solve_batch(known.nlp, starts)
    assert batch.success.all()
    assert (batch.x >= one.lbx).all()
    assert batch.objective == pytest.approx(np.ones(50), abs=1e-7)


def test_restoration_without_tapes() -> None:
    known = published(15)
    limits = np.array([np.inf]), 0.0
    options, rows = iterates.Options(1e-8, 1e-8, 0.1, 0.01, 500, *limits), np.arange(1)
    tapes = derivatives.numeric_problems(known.nlp, known.instance.p)
    casadi = derivatives.FunctionProblems(derivatives.Functions.calls(known.nlp), known.instance.p)
    one, other = (engine.minimise(each, known.instance, options, 1) for each in (tapes, casadi))
    np.testing.assert_allclose(one.x[rows], other.x[rows], rtol=1e-6)
    assert one.status == other.status == [Status.SOLVED]


def test_restoration_ends_where_the_violation_has_a_minimum() -> None:
    nlp, one = parabola(ubg=-1.0)
    squares = Nlp("squares", {"x": nlp.x}, {}, nlp.x, {"g": nlp.x**2})
    (solution,) = SOLVER.solve(squares, one)
    assert solution.status is Status.FAILED
    assert "violations was not reduced below 1" in solution.message


def test_operations_that_are_not_scalar_are_evaluated_by_casadi() -> None:
    grid = np.linspace(-3.0, 3.0, 31)
    table = ca.interpolant("table", "bspline", [grid], (grid - 1) ** 2)
    nlp, batch = parabola(table, lbx=-2.0, ubx=2.0)
    assert isinstance(derivatives.program_functions(nlp).values, tape.Calls)
    (solution,) = SOLVER.solve(nlp, batch)
    assert solution.status is Status.SOLVED
    assert solution.x[0] == pytest.approx(1.0, abs=1e-6)


def test_batch_agrees_with_ipopt() -> None:
    batch = valleys(3, 50)
    objectives = [
        np.array([solution.objective for solution in solver.solve(VALLEY, batch)])
        for solver in (SOLVER, Ipopt())
    ]
    # problems with two minima may end in either
    assert (abs(objectives[0] - objectives[1]) <= 1e-6).mean() >= 0.9


def test_fixed_variables_and_equal_bounds_are_kept() -> None:
    x = ca.MX.sym("x", 3)
    nlp = Nlp("fixed", {"x": x}, {}, ca.sumsqr(x - 2), {"sum": x[0] + x[1] + x[2]})
    fixed = {"lbx": [0.5, -5.0, -5.0], "ubx": [0.5, 5.0, 5.0], "lbg": 2.0, "ubg": 2.0}
    (solution,) = SOLVER.solve(nlp, instances(np.zeros(3), **fixed))
    assert solution.status is Status.SOLVED
    np.testing.assert_allclose(solution.x, [0.5, 0.75, 0.75], atol=1e-7)


def test_fixed_variables_have_multipliers_and_whole_numbers_are_floats() -> None:
    x = ca.SX.sym("x", 2)
    rows = ca.vertcat(x[0] + x[1])
    nlp = Nlp.from_expressions("whole", x, ca.SX(0, 1), ca.sumsqr(x - 1), rows)
    parts = [np.array([row]) for row in ([0, 0], [], [3, -9], [3, 9], [2], [2])]
    batch = SOLVER.solve_batch(nlp, Instances(*parts))
    (alone,) = SOLVER.solve(nlp, Instances(*parts))
    np.testing.assert_allclose(batch.x, [[3.0, -1.0]], atol=1e-7)
    assert batch.success.all()
    assert max(batch.stationarity[0], alone.residuals.stationarity) <= 1e-6


def test_rows_without_a_bound_do_not_spoil_the_verification() -> None:
    x = ca.SX.sym("x")
    nlp = Nlp.from_expressions("one-sided", x, ca.SX(0, 1), (x - 10) ** 2, x)
    one = instances([1.0], lbg=0.0, ubg=INF)
    batch = FilterInteriorPoint(mu_init=1e-9).solve_batch(nlp, one)
    assert batch.success.all()
    assert batch.stationarity[0] <= 1e-6


def test_answers_that_are_not_verified_go_to_the_fallback_and_are_no_success() -> None:
    x = ca.SX.sym("x", 2)
    nlp = Nlp.from_expressions("circle", x, ca.SX(0, 1), ca.sumsqr(x - 3), ca.sumsqr(x))
    instance = instances([1.0, 0.5], lbg=1.0, ubg=1.0)
    hasty = FilterInteriorPoint(tolerance=1.0, constraint_tolerance=1e-2)
    batch = hasty.solve_batch(nlp, instance)
    assert not batch.success[0]
    assert batch.messages[0].startswith("failed: ")
    helped = FilterInteriorPoint(tolerance=1.0, constraint_tolerance=1e-2, fallback=Ipopt())
    assert helped.solve_batch(nlp, instance).success[0]
    assert helped.solve(nlp, instance)[0].status is Status.SOLVED


def cliff() -> tuple[Nlp, Instances]:
    """CUTEst's CLIFF: a gradient of 1e10 at the initial guess, and a minimum of 0.19978661."""
    x = ca.SX.sym("x", 2)
    f = (x[0] / 100 - 0.03) ** 2 - x[0] + x[1] + ca.exp(20 * (x[0] - x[1]))
    return Nlp.from_expressions("cliff", x, ca.SX(0, 1), f, ca.SX(0, 1)), instances([0.0, -1.0])


def test_solutions_are_stationary_in_the_units_of_the_program() -> None:
    nlp, instance = cliff()
    (solution,) = SOLVER.solve(nlp, instance)
    assert solution.status is Status.SOLVED
    assert solution.residuals.stationarity <= 1e-4
    assert solution.objective == pytest.approx(0.19978661, abs=1e-8)


def test_points_of_the_fallback_that_are_not_stationary_are_no_success() -> None:
    nlp, instance = cliff()
    solver = FilterInteriorPoint(max_iter=0, fallback=Ipopt(tolerance=1e3))
    assert solver.fallback is not None
    assert solver.fallback.solve(nlp, instance)[0].status.success
    assert not solver.solve(nlp, instance)[0].status.success
    batch = solver.solve_batch(nlp, instance)
    assert not batch.success[0]
    assert batch.messages[0] == "failed: the point is not stationary"


def test_iterations_end_with_the_solution_that_is_within_the_tolerance() -> None:
    """At the limit of iterations, a solution in the method's units is one, and then judged."""
    nlp, instance = cliff()
    ended = {
        str(FilterInteriorPoint(max_iter=limit).solve_batch(nlp, instance).messages[0])
        for limit in range(20, 27)
    }
    assert "failed: the point is not stationary" in ended
    assert "solved: solved" in ended


def test_time_limit_ends_instances_that_are_not_solved() -> None:
    batch = valleys(3, 20)
    late = FilterInteriorPoint(time_limit=1e-9)
    solution = late.solve_batch(VALLEY, batch)
    assert not solution.success.any()
    assert np.isfinite(solution.x).all()
    assert {str(m) for m in solution.messages} == {
        "time limit: not solved within time_limit; allow more"
    }
    (alone,) = late.solve(VALLEY, batch[:1])
    assert alone.status is Status.TIME_LIMIT
    helped = replace(late, time_limit=10.0, max_iter=0, fallback=Ipopt())
    assert helped.solve_batch(VALLEY, batch).used_fallback.all()
    assert helped.solve_batch(VALLEY, batch).success.all()


def test_fallback_has_its_share_of_the_time_that_is_left() -> None:
    limits: list[float] = []

    class Asked(Ipopt):
        def timed_answers(self, nlp: Nlp, instances: Instances) -> Any:
            limits.append(self.time_limit)
            return super().timed_answers(nlp, instances)

    solver = FilterInteriorPoint(max_iter=0, time_limit=8.0, fallback=Asked(time_limit=100.0))
    solver.solve(VALLEY, valleys(3, 4))
    assert 1.0 <= limits[0] <= 2.0
    replace(solver, time_limit=np.inf).solve(VALLEY, valleys(3, 4))
    assert limits[1] == 100.0


def test_exception_of_one_instance_costs_that_instance_only() -> None:
    class Moody(ca.Callback):
        def __init__(self) -> None:
            ca.Callback.__init__(self)
            self.construct("moody", {"enable_fd": True})

        def eval(self, arguments: list[Any]) -> list[Any]:
            if float(arguments[0]) > 100:
                raise ValueError("no value here")
            return [arguments[0] ** 2]

    moody = Moody()
    nlp, one = parabola(moody)
    batch = SOLVER.solve_batch(nlp, one.with_x0(np.array([[3.0], [300.0]])))
    assert batch.messages[1].startswith("failed: raised RuntimeError")
    assert np.isfinite(batch.objective[0])


def test_program_without_variables_is_judged() -> None:
    p = ca.SX.sym("p")
    nlp = Nlp.from_expressions("nothing", ca.SX.sym("x", 0), p, ca.SX(1.0), p)
    one = instances([], [1.0], lbg=2.0, ubg=INF)
    assert not SOLVER.solve_batch(nlp, one).success.any()


@pytest.mark.slow
def test_programs_with_too_many_operations_have_no_tapes() -> None:
    x, size = ca.SX.sym("x", 80), 80
    weights = np.random.default_rng(0).normal(size=(size, size))
    dense = ca.sumsqr(ca.tanh(weights @ ca.tanh(weights @ x)))
    nlp = Nlp.from_expressions("dense", x, ca.SX(0, 1), dense, ca.SX(0, 1))
    assert isinstance(derivatives.program_functions(nlp).values, tape.Calls)


def test_empty_batch_has_an_empty_solution() -> None:
    empty = SOLVER.solve_batch(VALLEY, valleys(0, 3)[:0])
    assert empty.x.shape == (0, 2)
    assert empty.success.dtype == bool


def parabola(objective: Any = None, **bounds: float) -> tuple[Nlp, Instances]:
    x = ca.MX.sym("x")
    nlp = Nlp("parabola", {"x": x}, {}, x**2 if objective is None else objective(x), {"g": x})
    return nlp, instances([3.0], **{"lbg": -INF, "ubg": INF} | bounds)


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


# --- other units, narrow bounds, and threads


WIDTHS = [1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13, 1e-14, 2.3e-16]


def rosenbrock(length: float = 1.0, value: float = 1.0, row: float = 1.0) -> Nlp:
    """Rosenbrock's function in a disc and above a line, in other units."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 1)
    y = x / length
    objective = value * (100 * (y[1] - y[0] ** 2) ** 2 + (p - y[0]) ** 2)
    rows = row * ca.vertcat(ca.sumsqr(y), y[0] + y[1])
    return Nlp.from_expressions(f"rosenbrock {length} {value} {row}", x, p, objective, rows)


def starts(length: float = 1.0, row: float = 1.0, count: int = 20) -> Instances:
    rng = np.random.default_rng(3)
    x0, p = length * rng.uniform(-1.2, 1.2, (count, 2)), rng.uniform(0.5, 1.5, (count, 1))
    rows = {"lbg": [-INF, -2.0 * row], "ubg": [1.5 * row, INF]}
    return instances(x0, p, lbx=-5.0 * length, ubx=5.0 * length, **rows)


REFERENCE = SOLVER.solve_batch(rosenbrock(), starts())


@pytest.mark.parametrize("length", [1e-6, 1e-3, 1e6])
@pytest.mark.parametrize("value", [1e-8, 1.0, 1e6])
def test_minima_do_not_depend_on_units(length: float, value: float) -> None:
    batch = replace(starts(length), scale=np.array([[length, value]]))
    solution = SOLVER.solve_batch(rosenbrock(length, value), batch)
    assert REFERENCE.success.all()
    assert solution.success.all()
    np.testing.assert_allclose(solution.x / length, REFERENCE.x, atol=2e-6)
    np.testing.assert_allclose(solution.objective / value, REFERENCE.objective, atol=1e-7)
    assert solution.stationarity.max() <= 1e-6


@pytest.mark.parametrize("value", [1e-6, 1e6])
def test_large_and_small_objectives_are_minimised_without_their_scale(value: float) -> None:
    solution = SOLVER.solve_batch(rosenbrock(1.0, value), starts())
    if value > 1.0:  # a small one has small gradients, as at a minimum
        assert solution.success.all()
        np.testing.assert_allclose(solution.x, REFERENCE.x, atol=1e-4)
    assert (solution.stationarity[solution.success] <= 1e-4 * max(1.0, value)).all()


@pytest.mark.parametrize("row", [1e-6, 1e6])
def test_minima_do_not_depend_on_the_unit_of_rows(row: float) -> None:
    solution = SOLVER.solve_batch(rosenbrock(row=row), starts(row=row))
    assert (solution.success | (solution.violation > 1e-6)).all()
    assert solution.success.mean() >= 0.9  # violations are absolute: hard to meet at 1e6
    np.testing.assert_allclose(
        solution.x[solution.success], REFERENCE.x[solution.success], atol=1e-5
    )


def test_multipliers_are_in_units_of_the_problem() -> None:
    plain = SOLVER.run(rosenbrock(), starts())
    batch = replace(starts(1e3), scale=np.array([[1e3, 1e6]]))
    for one, two in zip(plain, SOLVER.run(rosenbrock(1e3, 1e6), batch), strict=True):
        np.testing.assert_allclose(two.multipliers[0] * 1e-3, one.multipliers[0], atol=1e-5)
        np.testing.assert_allclose(two.multipliers[1] * 1e-6, one.multipliers[1], atol=1e-5)


def between(low: float, high: float, row: bool = False) -> tuple[Nlp, Instances]:
    """Squares of the distance from (2, 1), x0 or a row x0 + x1 - 1 between two numbers."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 0)
    nlp = Nlp.from_expressions("between", x, p, (x[0] - 2) ** 2 + (x[1] - 1) ** 2, ca.sum1(x) - 1)
    wide, narrow = (-5.0, 5.0), (low, high)
    (lbx, ubx), (lbg, ubg) = (wide, narrow) if row else (narrow, (-INF, INF))
    return nlp, instances(np.zeros(2), lbx=[lbx, -5.0], ubx=[ubx, 5.0], lbg=lbg, ubg=ubg)


@pytest.mark.parametrize("row", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
def test_bounds_that_nearly_are_equal(width: float, row: bool) -> None:
    solution = SOLVER.solve_batch(*between(1.0, 1.0 + width, row))
    assert solution.success.all(), solution.messages
    expected = [[1.5, 0.5]] if row else [[1.0, 1.0]]
    np.testing.assert_allclose(solution.x, expected, atol=1e-6)
    assert solution.stationarity.max() <= 1e-6


@pytest.mark.parametrize("width", [1e-8, 1e-6, 1e-4, 1e-2, 1.0])
def test_active_bounds_at_large_numbers(width: float) -> None:
    solution = SOLVER.solve_batch(*between(1e6, 1e6 + width))
    assert solution.success.all(), solution.messages
    np.testing.assert_allclose(solution.x, [[1e6, 1.0]], rtol=1e-3)


@pytest.mark.parametrize("size", [1e20, 1e100, 1e308])
def test_huge_bounds_are_none(size: float) -> None:
    solution = SOLVER.solve_batch(*between(-size, size))
    assert solution.success.all(), solution.messages
    np.testing.assert_allclose(solution.x, [[2.0, 1.0]], atol=1e-6)


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (1.0, 0.0, "nothing is between lbx[0] = 1 and ubx[0] = 0"),
        (np.nan, 0.0, "nothing is between lbx[0] = nan and ubx[0] = 0"),
        (np.inf, np.inf, "nothing is between lbx[0] = inf and ubx[0] = inf"),
    ],
)
def test_bounds_without_a_number_between_are_named(low: float, high: float, shown: str) -> None:
    solution = SOLVER.solve_batch(*between(low, high))
    assert not solution.success.any()
    assert shown in solution.messages[0]


def many_rows() -> tuple[Nlp, Instances]:
    """Twelve rows of six variables, which many instances violate: sums of more than eight terms."""
    n, count, rng = 6, 60, np.random.default_rng(0)
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", n)
    rows = [
        ca.sin(x[i % n]) * x[(i + 1) % n] ** 2
        + p[i % n] * x[(i + 2) % n]
        - ca.exp(0.3 * x[(i + 3) % n])
        for i in range(12)
    ]
    objective = ca.sumsqr(x - p) + ca.sum1(ca.sin(3 * x))
    x0, parameters = rng.normal(0, 3, (count, n)), rng.normal(0, 1, (count, n))
    limits = {"lbg": np.full(12, -1.0), "ubg": np.where(np.arange(12) < 3, -1.0, 2.0)}
    batch = instances(x0, parameters, lbx=-10.0, ubx=10.0, **limits)
    return Nlp.from_expressions("rows", x, p, objective, ca.vcat(rows)), batch


@pytest.mark.slow
def test_many_rows_are_added_in_the_same_order_in_any_batch() -> None:
    nlp, batch = many_rows()
    together = SOLVER.solve_batch(nlp, batch)
    assert 0.5 < together.success.mean() < 1.0
    for row in range(len(batch)):
        alone = SOLVER.solve_batch(nlp, batch[row : row + 1])
        assert alone.messages[0] == together.messages[row]
        np.testing.assert_array_equal(alone.x[0], together.x[row])


def test_blas_has_its_threads_after_overlapping_blocks() -> None:
    def threads() -> list[int]:
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    def block(_: int) -> None:
        with one_blas_thread():
            SOLVER.solve_batch(rosenbrock(), starts(count=2))

    before = threads()
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(block, range(12)))
    assert threads() == before


# --- complementarity constraints, cusps, and windows that need restoration


def complementarity(form: str, balance: bool, pairs: int = 3) -> tuple[Nlp, Instances]:
    """The point nearest to a goal where x, y >= 0 and x y = 0, perhaps with y = M x + N z + q."""
    rng, free = np.random.default_rng(pairs), 2 if balance else 0
    size, rows = free + 2 * pairs, pairs if balance else 0
    v, p = ca.SX.sym("v", size), ca.SX.sym("p", size + rows)
    z, x, y = v[:free], v[free : free + pairs], v[free + pairs :]
    products = ca.dot(x, y) if form == "sum" else x * y
    root, coupling = rng.normal(size=(pairs, pairs)), rng.normal(size=(pairs, free))
    linear = y - (root @ root.T + np.eye(pairs)) @ x - p[size:] if balance else ca.SX(0, 1)
    linear = linear - coupling @ z if balance else linear
    goal, g = ca.sumsqr(v - p[:size]), ca.vertcat(linear, products)
    nlp = Nlp.from_expressions(f"complementarity {form} {balance}", v, p, goal, g)
    box = np.repeat([[-10.0, 0.0], [10.0, INF]], [free, 2 * pairs], axis=1)
    least = 0.0 if form == "equal" else -INF
    low = np.repeat([0.0, least], [rows, products.numel()])
    draws = rng.normal(size=(20, size + rows)) if balance else rng.uniform(0.2, 2, (20, size))
    limits = {"lbx": box[0], "ubx": box[1], "lbg": low, "ubg": np.zeros(len(low))}
    return nlp, instances(np.ones((20, size)), draws, **limits)


@pytest.mark.parametrize("balance", [False, True])
@pytest.mark.parametrize("form", ["each", "sum", "equal"])
def test_programs_with_complementarity_constraints_are_solved(form: str, balance: bool) -> None:
    nlp, batch = complementarity(form, balance)
    solution = SOLVER.solve_batch(nlp, batch)
    assert solution.success.all(), solution.messages
    assert solution.violation.max() <= 1e-6
    assert solution.stationarity.max() <= 1e-4
    relaxed = ["relaxed bounds" in message for message in solution.messages]
    assert any(relaxed) == (form != "equal")  # only those that are not solved otherwise
    ipopt = Ipopt().solve_batch(nlp, batch[:5])
    np.testing.assert_allclose(solution.objective[:5], ipopt.objective, atol=1e-5)
    for row in (0, 13):
        alone = SOLVER.solve_batch(nlp, batch[row : row + 1])
        assert alone.x.tolist() == solution.x[[row]].tolist()


def test_relaxed_bounds_are_within_the_tolerance_and_equal_ones_stay() -> None:
    one = instances(np.zeros(3), lbx=[-INF, 0.0, 2.0], ubx=[1e6, 5.0, 2.0], lbg=[], ubg=[])
    relaxed = iterates.relaxed_bounds(one, 1e-7)
    np.testing.assert_array_equal(relaxed.lbx, [[-INF, -1e-8, 2.0]])
    np.testing.assert_array_equal(relaxed.ubx, [[1e6 + 1e-7, 5.0 + 5e-8, 2.0]])


def test_success_at_cusps_has_multipliers() -> None:
    x = ca.SX.sym("x", 2)
    nlp = Nlp.from_expressions("cusp", x, ca.SX(0, 1), -x[0], (1 - x[0]) ** 3 - x[1])
    starts = np.random.default_rng(0).uniform(0.0, 1.0, (30, 2))
    starts[0] = 0.0
    batch = SOLVER.solve_batch(nlp, instances(starts, lbx=0.0, lbg=0.0, ubg=INF))
    assert "no multipliers found" in batch.messages[0]
    assert (batch.stationarity[batch.success] <= 1.0).all()
    np.testing.assert_allclose(batch.x[:, 0], 1.0, atol=5e-3)  # (2e-8)^(1/3) with relaxed bounds


def test_windows_of_a_cart_and_pole_are_solved_without_fallback() -> None:
    nlp, batch = cart_poles(120)
    some = batch[np.r_[:20, 34, 66, 103, 107, 113, 119]]  # the last need long restorations
    solution = SOLVER.solve_batch(nlp, some)
    assert solution.success.all(), solution.messages
    assert solution.violation.max() <= 1e-6
    assert solution.stationarity.max() <= 1e-4
