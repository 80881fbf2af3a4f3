"""Tapes of scalar operations and sparse factors: the numbers of CasADi and of NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from casadi_operations import BINARY, UNARY
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from casswarm.solvers.interior_point.factors import SparseFactors, SparseSystem, eliminate
from casswarm.solvers.interior_point.tape import Tape, scalar

MORE = [ca.asin, ca.acos, ca.asinh, ca.acosh, ca.atanh, ca.erf, lambda a: a**1.7, lambda a: 2 * a]
KERNELS: list[tuple[int, Callable[..., Any]]] = [
    *((1, kernel) for kernel in (*(kernel for kernel, _ in UNARY.values()), *MORE)),
    *((2, kernel) for kernel, _ in BINARY.values()),
    *((2, kernel) for kernel in (ca.copysign, lambda a, b: ca.if_else(a > 0, b, -b))),
]
POINTS = np.array([[-2.5, 0.5], [-0.5, -1.0], [0.0, 0.0], [0.25, 0.75], [0.9, 2.0], [3.0, 3.0]])


@pytest.mark.parametrize(("inputs", "kernel"), KERNELS)
def test_operation_is_that_of_casadi(inputs: int, kernel: Callable[..., Any]) -> None:
    symbols = [ca.SX.sym("a"), ca.SX.sym("b")]
    result = kernel(*symbols[:inputs])
    function = ca.Function("f", symbols, [result])
    expected = [float(function(*point)) for point in POINTS]
    (values,) = Tape.of(symbols, [result])(*np.vsplit(POINTS.T, 2))
    np.testing.assert_array_max_ulp(values[0], np.array(expected), 2)


@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([1, 63, 64, 65, 200]))
@settings(max_examples=10)
def test_random_expressions_and_batches(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    terms = [*ca.vertsplit(x), *ca.vertsplit(p)]
    smooth = [ca.sin, ca.tanh, lambda a: a / 2, lambda a: a**2 / 4]
    for _ in range(20):
        i, j, k = rng.integers(len(terms)), rng.integers(len(terms)), rng.integers(len(smooth))
        terms.append(smooth[k](terms[i]) - terms[j] * 0.5)
    f, sparse = ca.vertcat(*terms[-4:]), ca.diag(ca.vertcat(*terms[-3:]))
    function = ca.Function("f", [x, p], [f, sparse])
    at, parameters = rng.normal(size=(3, count)), rng.normal(size=(2, count))
    values, entries = Tape.of([x, p], [f, sparse])(at, parameters)
    for row in range(count):
        expected = [np.asarray(out.nonzeros()) for out in function(at[:, row], parameters[:, row])]
        np.testing.assert_allclose(values[:, row], expected[0], rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(entries[:, row], expected[1], rtol=1e-14, atol=1e-14)


def test_operations_that_are_not_scalar_have_no_tape() -> None:
    table = ca.interpolant("table", "bspline", [[0.0, 1.0, 2.0, 3.0]], [0.0, 1.0, 4.0, 9.0])
    x, y = ca.MX.sym("x"), ca.SX.sym("y")
    with pytest.raises(NotImplementedError):
        Tape.of([y], [scalar(ca.Function("f", [x], [table(x)]))(y)])


def random_pattern(rng: np.random.Generator, size: int, rows: int) -> tuple[NDArray[Any], ...]:
    """Entries of a Hessian's upper triangle, and of a Jacobian, in any order."""
    hessian = np.argwhere(np.triu(rng.random((size, size)) < 2 / size)).T
    jacobian = rng.permutation(np.argwhere(rng.random((rows, size)) < 2 / size)).T
    return hessian, jacobian


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 12), rows=st.integers(0, 9))
@settings(max_examples=25)
def test_sparse_factors_solve_the_dense_systems(seed: int, size: int, rows: int) -> None:
    rng, batch = np.random.default_rng(seed), 70
    hessian, jacobian = random_pattern(rng, size, rows)
    system = SparseSystem.of(size, hessian, jacobian)
    values = [rng.normal(size=(batch, part.shape[1])) for part in (hessian, jacobian)]
    values += [rng.uniform(0.1, 9.0, (batch, part)) for part in (rows, size)]
    columns = tuple(np.ascontiguousarray(value.T) for value in values)
    factors = SparseFactors(system, columns, np.zeros(batch))
    right = rng.normal(size=(batch, size))
    solutions = factors.solve(np.ascontiguousarray(right.T)).T
    for i in range(batch):
        dense, a = np.diag(values[3][i]), np.zeros((rows, size))
        np.add.at(dense, tuple(hessian), values[0][i])
        upper = hessian[0] < hessian[1]
        np.add.at(dense, tuple(hessian[::-1, upper]), values[0][i][upper])
        a[tuple(jacobian)] = values[1][i]
        dense += a.T @ (values[2][i][:, None] * a) + factors.shifts[i] * np.eye(size)
        assert np.linalg.eigvalsh(dense)[0] > 0.0
        if factors.shifts[i] > 0.0:
            without = dense - factors.shifts[i] * np.eye(size)
            assert np.linalg.eigvalsh(without)[0] < 1e-9
        error = dense @ solutions[i] - right[i]
        assert abs(error).max() <= 1e-9 * np.linalg.cond(dense)


def test_factors_do_not_depend_on_the_rest_of_the_batch() -> None:
    """Where some are not positive definite, eight shifts of each are tried together."""
    curvatures, last, indefinite = np.ones((2, 17)), np.zeros(17), [0, 15]
    curvatures[:, indefinite], last[indefinite] = [[-0.5, -1e-3], [1.0, -7.0]], [0.0, 1e-6]
    system = SparseSystem.of(2, np.array([[0, 1], [0, 1]]), np.empty((2, 0), np.int64))
    values = curvatures, np.empty((0, 17)), np.empty((0, 17)), np.full((2, 17), 1e-5)
    factors = SparseFactors(system, values, last)
    assert np.flatnonzero(factors.shifts).tolist() == indefinite
    solutions = factors.solve(np.ones((2, 17)))
    for i in range(17):
        alone = SparseFactors(system, tuple(v[:, i : i + 1] for v in values), last[i : i + 1])
        assert alone.shifts[0] == factors.shifts[i]
        assert (alone.solve(np.ones((2, 1)))[:, 0] == solutions[:, i]).all()


def test_elimination_of_a_chain_has_no_fill() -> None:
    chain = np.arange(49)
    pattern = eliminate(50, chain, chain + 1)
    assert len(pattern.rows) == 50 + 49


def test_elimination_of_the_nodes_of_a_grid_has_little_fill() -> None:
    grid = np.arange(4900).reshape(70, 70)
    one = np.concatenate([grid[:, 1:].ravel(), grid[1:].ravel()])
    two = np.concatenate([grid[:, :-1].ravel(), grid[:-1].ravel()])
    pattern = eliminate(4900, one, two)
    assert sorted(pattern.order) == list(range(4900))
    assert len(pattern.rows) < 250_000


def test_elimination_of_a_large_dense_matrix_is_refused() -> None:
    one, two = np.triu_indices(200)
    assert eliminate(200, one, two) is None


def test_a_row_of_all_of_many_variables_is_refused_at_once() -> None:
    every = np.arange(5000)
    assert SparseSystem.of(5000, np.stack([every, every]), np.stack([0 * every, every])) is None
