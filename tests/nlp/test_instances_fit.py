"""Arrays that do not fit a program are refused by every solver, before any of them is read."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import casswarm as csw
from casswarm import nlp, solvers

X, P = ca.MX.sym("x", 2), ca.MX.sym("p", 3)
PROGRAM = nlp.Nlp.from_expressions("sums", X, P, ca.sumsqr(X - P[:2]), X[0] + X[1] - P[2])
ARRAYS = {
    "x0": np.ones((4, 2)),
    "p": np.ones((4, 3)),
    "lbx": np.full((4, 2), -9.0),
    "ubx": np.full((4, 2), 9.0),
    "lbg": np.full((4, 1), -9.0),
    "ubg": np.full((4, 1), 9.0),
    "scale": np.ones((4, 2)),
}


def with_shape(name: str, shape: tuple[int, ...]) -> dict[str, Any]:
    return ARRAYS | {name: np.ones(shape)}


@pytest.mark.parametrize("solver", ["interior-point", "ipopt", "sqp", "auto", "slsqp", "sleqp"])
@pytest.mark.parametrize("name", list(ARRAYS))
@pytest.mark.parametrize("surplus", [-1, 1])
def test_array_of_wrong_width_is_refused(solver: str, name: str, surplus: int) -> None:
    width = ARRAYS[name].shape[1] + surplus
    instances = nlp.Instances(**with_shape(name, (4, width)))
    chosen = solvers.make_solver(solver)
    for solve in (chosen.solve, chosen.solve_batch):
        with pytest.raises(csw.SolverError) as caught:
            solve(PROGRAM, instances)
        expected = f"expected: (4, {ARRAYS[name].shape[1]}) for the program 'sums'"
        assert str(caught.value) == f"{name} of the instances has shape (4, {width}); {expected}"
        assert (caught.value.key, caught.value.shape) == (name, (4, width))


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        *(("p", (3, 3)), ("lbx", (4, 1, 2)), ("ubg", ()), ("p", (5, 3)), ("scale", (3, 2))),
        *(("x0", ()), ("x0", (2,))),
    ],
)
def test_array_without_a_row_for_each_instance_is_refused(name: str, shape: Any) -> None:
    with pytest.raises(csw.SolverError, match=rf"{name} of the instances has shape .*; expected: "):
        nlp.Instances(**with_shape(name, shape))
