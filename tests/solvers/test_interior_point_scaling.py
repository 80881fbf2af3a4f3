"""The batched interior-point method in other units, with narrow bounds, and from threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from known_problems import INF, instances
from threadpoolctl import threadpool_info

from casswarm._util.threads import one_blas_thread
from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint

SOLVER = FilterInteriorPoint()
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
        assert one.multipliers is not None
        assert two.multipliers is not None
        np.testing.assert_allclose(two.multipliers[0] * 1e-3, one.multipliers[0], atol=1e-5)
        np.testing.assert_allclose(two.multipliers[1] * 1e-6, one.multipliers[1], atol=1e-5)


def parabola(low: float, high: float, row: bool = False) -> tuple[Nlp, Instances]:
    """Squares of the distance from (2, 1), x0 or a row x0 + x1 - 1 between two numbers."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 0)
    nlp = Nlp.from_expressions("parabola", x, p, (x[0] - 2) ** 2 + (x[1] - 1) ** 2, ca.sum1(x) - 1)
    wide, narrow = (-5.0, 5.0), (low, high)
    (lbx, ubx), (lbg, ubg) = (wide, narrow) if row else (narrow, (-INF, INF))
    return nlp, instances(np.zeros(2), lbx=[lbx, -5.0], ubx=[ubx, 5.0], lbg=lbg, ubg=ubg)


@pytest.mark.parametrize("row", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
def test_bounds_that_nearly_are_equal(width: float, row: bool) -> None:
    solution = SOLVER.solve_batch(*parabola(1.0, 1.0 + width, row))
    assert solution.success.all(), solution.messages
    expected = [[1.5, 0.5]] if row else [[1.0, 1.0]]
    np.testing.assert_allclose(solution.x, expected, atol=1e-6)
    assert solution.stationarity.max() <= 1e-6


@pytest.mark.parametrize("width", [1e-8, 1e-6, 1e-4, 1e-2, 1.0])
def test_active_bounds_at_large_numbers(width: float) -> None:
    solution = SOLVER.solve_batch(*parabola(1e6, 1e6 + width))
    assert solution.success.all(), solution.messages
    np.testing.assert_allclose(solution.x, [[1e6, 1.0]], rtol=1e-3)


@pytest.mark.parametrize("size", [1e20, 1e100, 1e308])
def test_huge_bounds_are_none(size: float) -> None:
    solution = SOLVER.solve_batch(*parabola(-size, size))
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
    solution = SOLVER.solve_batch(*parabola(low, high))
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
