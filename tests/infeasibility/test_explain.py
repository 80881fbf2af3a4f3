"""Explanations of infeasible programs: what is named is a contradiction, and nothing is spare."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import casswarm as csw
from casswarm.errors import ProblemError
from casswarm.nlp.program import Instances, Nlp

X = ca.SX.sym("x", 3)


def require_verified(found: csw.Explanation, rows: Any, **arguments: Any) -> None:
    """Assert that every witness meets all that is named but one, by CasADi's own values."""
    g = ca.Function("g", [X], [rows])
    bounds = [int(name[2:-1]) for name in found.variables]
    assert len(found.witnesses) == len(found.row_indices) + len(bounds)
    entries = [(0, i) for i in found.row_indices] + [(1, j) for j in bounds]
    names = (("lbg", "ubg"), ("lbx", "ubx"))
    for left, x in enumerate(found.witnesses):
        values = np.asarray(g(x)).ravel(), x
        for other, (part, i) in enumerate(entries):
            low, high = (
                np.broadcast_to(arguments.get(name, side * np.inf), values[part].shape)[i]
                for name, side in zip(names[part], (-1, 1), strict=True)
            )
            met = low - 1e-5 <= values[part][i] <= high + 1e-5
            assert met or other == left
    assert found.violation > 1e-6


CASES = {
    "a disc and a half-plane": (
        ca.vertcat(ca.sumsqr(X), X[0], X[1] + X[0] + X[2]),
        {"lbg": [-np.inf, -1, 3], "ubg": [1, 1, np.inf]},
        ((0, 2), ()),
        False,
    ),
    "equalities": (
        ca.vertcat(X[0] + X[1], X[1] - X[2], X[0] + X[2], X[0]),
        {"lbg": [1, 2, 5, -9], "ubg": [1, 2, 5, 9]},
        ((0, 1, 2), ()),
        True,
    ),
    "a row and bounds": (
        ca.vertcat(X[0] + X[1], X[2]),
        {"lbg": [3, 0], "lbx": [0, 0, -1], "ubx": [1, 1, 1]},
        ((0,), ("x[0]", "x[1]")),
        True,
    ),
    "a nonlinear row and a bound": (
        ca.vertcat(ca.exp(X[0]), X[1]),
        {"lbg": [3, 0], "ubx": [1, 5, 5]},
        ((0,), ("x[0]",)),
        False,
    ),
    "a constant row": (
        ca.vertcat(X[0], 0 * X[0]),
        {"lbg": [0, 1]},
        ((1,), ()),
        True,
    ),
    "a row without values": (X[0] ** 2 + X[1] ** 2, {"ubg": -1}, ((0,), ()), False),
}


@pytest.mark.parametrize("name", CASES)
def test_explain_names_the_contradiction(name: str) -> None:
    rows, arguments, (indices, variables), proven = CASES[name]
    found = csw.explain({"x": X, "f": X[0], "g": rows}, x0=[0.3, 0.2, 0.1], **arguments)
    assert found.feasible is False
    assert (found.row_indices, found.variables) == (indices, variables)
    assert found.rows == tuple(f"g[{i}]" for i in indices)
    assert found.proven is proven
    require_verified(found, rows, **arguments)
    assert all(name in str(found) for name in (*found.rows, *variables))
    assert ("no proof" in str(found)) is not proven


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("name", ["a disc and a half-plane", "equalities", "a row and bounds"])
def test_explain_in_other_units_and_orders_names_the_same(name: str, scale: float) -> None:
    rows, arguments, (indices, variables), _ = CASES[name]
    ng = rows.numel()
    order = np.roll(np.arange(ng), 1)
    factors = scale ** np.linspace(-1, 1, ng)
    units = np.array([1.0, 1.0, 1.0]) * scale
    g = ca.substitute(rows, X, X / ca.DM(units)) * ca.DM(factors)
    changed: dict[str, Any] = {"x0": np.array([0.3, 0.2, 0.1]) * units}
    for key, value in arguments.items():
        changed[key] = (
            (np.asarray(value, float) * factors)[order]
            if key in ("lbg", "ubg")
            else np.asarray(value, float) * units
        )
    found = csw.explain({"x": X, "g": g[[int(i) for i in order]]}, **changed)
    assert found.feasible is False
    assert sorted(order[list(found.row_indices)]) == list(indices)
    assert found.variables == variables


def test_explain_of_a_feasible_program_gives_a_point() -> None:
    rows = ca.vertcat(ca.sumsqr(X), X[0] * X[1], X[2])
    found = csw.explain({"x": X, "g": rows}, lbg=[4, 0.5, 1], ubg=[4, 0.5, 1], lbx=0)
    assert found.feasible is True
    values = np.asarray(ca.Function("g", [X], [rows])(found.point)).ravel()
    np.testing.assert_allclose(values, [4, 0.5, 1], atol=1e-6)
    assert found.point.min() >= -1e-6
    assert found.violation <= 1e-6
    assert found.rows == found.row_indices == found.variables == ()
    assert "feasible" in str(found)


def test_explain_of_a_program_without_rows_is_feasible() -> None:
    assert csw.explain({"x": X, "f": ca.sumsqr(X)}, lbx=1).feasible is True


def test_explain_of_opti_counts_constraints() -> None:
    opti = ca.Opti()
    x, limit = opti.variable(3), opti.parameter()
    opti.set_value(limit, 1)
    opti.subject_to(x >= 0)
    opti.subject_to(opti.bounded(-1, x[0] - x[1], 1))
    opti.subject_to(ca.sum1(x) <= -limit)
    opti.subject_to(x <= 10)
    found = csw.explain(opti)
    assert found.row_indices == (0, 2)
    assert found.rows[0].startswith("constraint 0 (test_explain.py:")
    assert found.proven
    assert pickle.loads(pickle.dumps(found)).rows == found.rows


def test_explain_of_a_file_names_rows_as_its_names(tmp_path: Path) -> None:
    rows = ca.vertcat(X[0] + X[1], X[2], X[0] + X[1])
    problem = csw.Problem.from_casadi({"x": X, "f": X[0], "g": rows}, lbg=[2, 0, 0], ubg=[3, 1, 1])
    problem.to_nl(tmp_path / "file.nl")
    assert csw.explain(csw.Problem.from_nl(tmp_path / "file.nl")).rows == ("c0", "c2")
    (tmp_path / "file.row").write_text("demand\nother\nsupply\n")
    assert csw.explain(csw.Problem.from_nl(tmp_path / "file.nl")).rows == ("demand", "supply")


def blocks(low: list[float], high: list[float]) -> tuple[Nlp, Instances]:
    """A program of named blocks with bounds of its two variables."""
    x = ca.MX.sym("x", 2)
    nlp = Nlp("blocks", {"position": x}, {}, x[0], {"sum": x[0] + x[1]})
    return nlp, Instances(*np.array([[[0.0, 0.0]]]), np.empty((1, 0)), [low], [high], [[1]], [[9]])


def test_rows_that_are_alike_are_listed_by_their_ends() -> None:
    """Steps of 0.1 that cannot lead from 0 to 2: all of them, and both ends, are in the way."""
    x = ca.SX.sym("x", 11)
    g = ca.vertcat(ca.diff(x), x[0], x[10])
    low, high = [-0.1] * 10 + [0.0, 2.0], [0.1] * 10 + [0.0, np.inf]
    found = csw.explain({"x": x, "g": g}, lbg=low, ubg=high)
    assert found.row_indices == tuple(range(12))
    listed = "-0.1 <= g[0] <= 0.1 to -0.1 <= g[9] <= 0.1, g[10] = 0, g[11] >= 2 contradict"
    assert listed in str(found)


def test_explain_of_crossed_bounds_names_the_variable() -> None:
    found = csw.explain(*blocks([0, 3], [1, 2]))
    assert found.feasible is False
    assert found.variables == ("position[1]",)
    assert found.proven
    assert found.violation > 0


def test_explain_of_blocks_names_their_entries() -> None:
    found = csw.explain(*blocks([-1, -1], [0, 0.5]))
    assert (found.rows, found.variables) == (("sum[0]",), ("position[0]", "position[1]"))


def test_explain_of_functions_that_are_never_finite_is_undecided() -> None:
    x = ca.MX.sym("x")
    nlp = Nlp("nan", {"x": x}, {}, x, {"root": ca.sqrt(-1 - x**2)})
    found = csw.explain(nlp, Instances([[1.0]], np.empty((1, 0)), [[-9]], [[9]], [[0]], [[1]]))
    assert found.feasible is None
    assert "root[0]" in str(found)


@pytest.mark.parametrize("wrong", [(3,), (blocks([0, 0], [1, 1])[0],)])
def test_explain_of_something_else_is_refused(wrong: Any) -> None:
    with pytest.raises(ProblemError, match="allowed: a Problem"):
        csw.explain(*wrong)
