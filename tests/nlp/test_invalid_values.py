"""Functions and derivatives that are not finite are named, in words."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casswarm import nlp, solvers

X = ca.MX.sym("x", 2)
ROOT = ca.sqrt(ca.fmax(-(X[1] ** 2), 0))  # 0 everywhere, with derivatives that are not a number
SLOPE = "the derivative of the {} with respect to x[1] is nan"


def posed(f, g=None):
    program = nlp.Nlp.from_expressions("named", X, ca.MX(0, 1), f, ca.MX(0, 1) if g is None else g)
    rows = program.sizes[2]
    bounds = np.full((1, 2), np.inf), np.full((1, rows), np.inf)
    instance = nlp.Instances(
        x0=np.ones((1, 2)), p=np.zeros((1, 0)),
        lbx=-bounds[0], ubx=bounds[0], lbg=-bounds[1], ubg=bounds[1],
    )  # fmt: skip
    return program, instance


@pytest.mark.parametrize(
    ("f", "g", "x", "expected"),
    [
        (X[0] ** 2, None, [2.0, 1.0], ""),
        (ca.log(X[0]), None, [-1.0, 1.0], "the objective is nan"),
        (X[0], ca.vertcat(X[1], 1 / X[0]), [0.0, 1.0], "the constraint g[1] is inf"),
        (X[0] + ROOT, None, [2.0, 1.0], SLOPE.format("objective")),
        (X[0], ROOT, [2.0, 1.0], SLOPE.format("constraint g[0]")),
        (X[0] + ROOT, None, [np.nan, 1.0], SLOPE.format("objective") + " at the initial guess"),
    ],
)  # fmt: skip
def test_invalid_value_is_named(f, g, x, expected):
    assert nlp.invalid_value(*posed(f, g), np.array(x)) == expected


def test_solution_that_failed_says_which_derivative_is_not_finite():
    (found,) = solvers.make_solver("ipopt").solve(*posed((X[0] - 3) ** 2 + ROOT))
    assert found.status is nlp.Status.FAILED
    assert "the derivative of the objective with respect to x[1] is nan" in found.message
