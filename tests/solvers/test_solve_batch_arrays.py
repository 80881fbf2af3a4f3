"""Arrays that instances and batches of them are made of: what is refused, and what is the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casswarm.errors import SolverError
from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint, Ipopt, Slsqp, Solver

X, P = ca.SX.sym("x", 2), ca.SX.sym("p")
NLP = Nlp.from_expressions("bowl", X, P, ca.sumsqr(X - P), ca.sum1(X))
"""The minimum is at (p, p)."""
SOLVERS = [FilterInteriorPoint(), Ipopt(), Slsqp()]


def instances(**others: Any) -> Instances:
    arrays: dict[str, Any] = {"x0": np.ones((2, 2)), "p": np.array([[0.5], [2.0]])}
    arrays |= {"lbx": np.full(2, -9.0), "ubx": np.full(2, 9.0)}
    return Instances(**arrays | {"lbg": [-9.0], "ubg": [9.0]} | others)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "complex": ({"x0": np.ones((2, 2), complex)}, "x0 of the instances is an array of complex128"),
    "texts": ({"p": [["a"], ["b"]]}, "p of the instances is an array of <U1"),
    "ragged": ({"x0": [[1.0, 2.0], [1.0]]}, "x0 of the instances is a list; allowed: arrays of"),
    "none": ({"p": None}, r"p of the instances has shape \(\); expected: \(2, ...\)"),
    "vector": ({"x0": np.ones(2)}, r"x0 .* has shape \(2,\); expected: \(B, ...\)"),
    "scalar": ({"lbx": -9.0}, r"lbx .* has shape \(\); expected: \(2, ...\)"),
    "zero scale": ({"scale": np.zeros(2)}, r"scale\[0, 0\] .* is 0; allowed: above 0, finite"),
    "scale": ({"scale": [[1.0, np.nan]]}, r"scale\[0, 1\] .* is nan; allowed: above 0, finite"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_arrays_that_are_no_instances_are_refused(name: str) -> None:
    arrays, words = REFUSED[name]
    with pytest.raises(SolverError, match=words):
        instances(**arrays)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize(
    ("name", "width", "expected"),
    [("p", 0, 1), ("p", 3, 1), ("x0", 3, 2), ("ubx", 1, 2), ("lbg", 0, 1), ("scale", 3, 2)],
)
def test_arrays_of_other_programs_are_refused(
    solver: Solver, name: str, width: int, expected: int
) -> None:
    words = rf"{name} .* has shape \(2, {width}\); expected: \(2, {expected}\) for the program"
    with pytest.raises(SolverError, match=words):
        solver.solve_batch(NLP, instances(**{name: np.ones((2, width))}))


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "read-only": read_only,
    "in columns": np.asfortranarray,
    "strided": lambda array: np.repeat(np.repeat(array, 2, 0), 3, 1)[::2, ::3],
    "single": lambda array: array.astype(np.float32),
    "big-endian": lambda array: array.astype(">f8"),
    "objects": lambda array: array.astype(object),
    "lists": np.ndarray.tolist,
    "casadi": ca.DM,
}


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_answers_do_not_depend_on_the_form_of_arrays(solver: Solver) -> None:
    plain = instances()
    expected = solver.solve_batch(NLP, plain)
    np.testing.assert_allclose(expected.x, np.repeat(plain.p, 2, axis=1), atol=1e-6)
    for form in FORMS.values():
        posed = instances(**{name: form(np.array(getattr(plain, name))) for name in ("x0", "p")})
        np.testing.assert_array_equal(solver.solve_batch(NLP, posed).x, expected.x)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize("name", ["p", "lbx", "ubg"])
def test_instance_with_nan_is_no_success_and_costs_no_other(solver: Solver, name: str) -> None:
    array = np.array(getattr(instances(), name))
    array[1, 0] = np.nan
    batch = solver.solve_batch(NLP, instances(**{name: array}))
    assert batch.success.tolist() == [True, False]
    np.testing.assert_allclose(batch.x[0], 0.5, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_empty_batch_has_empty_arrays_of_the_right_widths(solver: Solver) -> None:
    batch = solver.solve_batch(NLP, instances()[:0])
    assert (batch.x.shape, batch.lam_x.shape, batch.lam_g.shape) == ((0, 2), (0, 2), (0, 1))
    assert batch.success.shape == batch.iterations.shape == (0,)
