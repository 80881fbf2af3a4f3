"""Problems of PyCUTEst and S2MPJ, by stand-ins with their interfaces: neither is installed."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from available_solvers import GENERAL
from cutest_fakes import BIG, HS71, PYCUTEST, CUTEstProblem, Unconstrained
from hock_schittkowski import published

import casswarm as csw
from casswarm._util.child import packed
from casswarm.nlp import LagrangianHessian
from casswarm.solvers import SOLVERS, make_solver

KINDS: dict[str, Callable[[], csw.Problem]] = {
    "pycutest": lambda: csw.Problem.from_pycutest(CUTEstProblem()),
    "s2mpj": lambda: csw.Problem.from_s2mpj(HS71()),
}
RUNNING = [name for name in GENERAL if not SOLVERS[name].unavailable()]
POINT = np.array([1.5, 2.0, 3.0, 2.5])


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycutest", PYCUTEST)


QUICK = ("ipopt", "sqp", "uno", "unopy", "slsqp")
CASES = [
    pytest.param(kind, name, marks=() if name in QUICK else pytest.mark.slow)
    for kind in KINDS
    for name in RUNNING
]


@pytest.mark.parametrize(("kind", "solver"), CASES)
def test_every_solver_finds_published_optimum(kind: str, solver: str) -> None:
    problem = KINDS[kind]()
    (solution,) = make_solver(solver).solve(problem.nlp, problem.starts["given"])
    assert solution.status.success, solution
    assert solution.objective == pytest.approx(17.0140173, abs=1e-6)
    assert solution.residuals.stationarity < 2e-5


def derivatives(nlp: Any, weights: tuple[float, float, float]) -> list[Any]:
    """Gradient, Jacobian and Hessian of the Lagrangian by differentiation of expressions."""
    multipliers = ca.DM(weights[1:])
    lagrangian = weights[0] * nlp.objective + ca.dot(multipliers, nlp.g)
    hessian = ca.Function("hessian", [nlp.x, nlp.p], [ca.hessian(lagrangian, nlp.x)[0]])
    parts = nlp.gradient(POINT, [])[1], nlp.jacobian(POINT, []), hessian(POINT, [])
    return [np.asarray(ca.densify(part)) for part in parts]


@pytest.mark.parametrize("weights", [(1.0, 0.5, -2.0), (0.0, 1.0, 1.0), (0.3, -1.0, 0.0)])
def test_derivatives_equal_those_of_expressions(weights: tuple[float, float, float]) -> None:
    expected = derivatives(published(71).nlp, weights)
    rows = {"pycutest": slice(None), "s2mpj": slice(None, None, -1)}
    for kind, pose in KINDS.items():
        nlp, order = pose().nlp, rows[kind]
        multipliers = np.array(weights[1:])[order]
        found = derivatives(nlp, (weights[0], *multipliers))
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-13)
        np.testing.assert_allclose(found[1][order], expected[1], rtol=1e-13)
        np.testing.assert_allclose(found[2], expected[2], rtol=1e-13)
        own = nlp.attached(LagrangianHessian)(POINT, [], weights[0], multipliers)
        np.testing.assert_allclose(np.asarray(own), np.triu(expected[2]), rtol=1e-13)


def test_problem_keeps_names_numbers_and_infinities() -> None:
    problem = csw.Problem.from_pycutest(CUTEstProblem(), family="mine")
    instance = problem.starts["given"]
    assert repr(problem) == "<Problem HS71 of the family mine: 4 variables, 2 constraints>"
    assert instance.x0.tolist() == [[1, 5, 5, 1]]
    assert (instance.lbg.tolist(), instance.ubg.tolist()) == ([[25, 40]], [[np.inf, 40]])
    assert csw.Problem.from_s2mpj(HS71(), "own name").name == "own name"


def test_problems_without_constraints_or_objective_are_solved() -> None:
    problem = csw.Problem.from_pycutest(Unconstrained())
    assert problem.nlp.sizes == (4, 0, 0)
    (solution,) = make_solver("ipopt").solve(problem.nlp, problem.starts["given"])
    np.testing.assert_allclose(solution.x, 2.0, atol=1e-6)
    made = HS71()
    made.objgrps = np.array([])
    problem = csw.Problem.from_s2mpj(made)
    assert float(problem.nlp.evaluate(POINT, [])[0]) == 0
    (solution,) = make_solver("ipopt").solve(problem.nlp, problem.starts["given"])
    assert solution.status.success


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("kind", KINDS)
def test_problem_pickles(kind: str) -> None:
    problem = KINDS[kind]()
    again = pickle.loads(packed(problem))  # as it is sent to the processes of solvers
    assert again.fingerprint() == problem.fingerprint()
    (solution,) = make_solver("ipopt").solve(again.nlp, again.starts["given"])
    assert solution.objective == pytest.approx(17.0140173, abs=1e-6)


@pytest.mark.usefixtures("installed")
def test_name_is_imported_with_its_parameters() -> None:
    problem = csw.Problem.from_pycutest("HS71", N=4)
    assert problem.nlp.box.problem.sifParams == {"N": 4}  # type: ignore[attr-defined]
    again = pickle.loads(pickle.dumps(problem))
    assert again.nlp.box.problem.sifParams == {"N": 4}
    with pytest.raises(csw.ProblemError, match=r"cannot import the problem 'NONE'.*NONE\.SIF"):
        csw.Problem.from_pycutest("NONE")


def test_missing_pycutest_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycutest", None)
    with pytest.raises(csw.ProblemError, match="'HS71' needs PyCUTEst, with CUTEst and a Fortran"):
        csw.Problem.from_pycutest("HS71")


def test_s2mpj_is_loaded_by_name() -> None:
    problem = csw.Problem.from_s2mpj("HS71")
    assert problem.nlp.sizes == (4, 0, 2)
    expected = derivatives(published(71).nlp, (1.0, 0.5, -2.0))
    found = derivatives(problem.nlp, (1.0, -2.0, 0.5))  # equations are before inequalities
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-13)
    np.testing.assert_allclose(found[1][::-1], expected[1], rtol=1e-13)
    np.testing.assert_allclose(found[2], expected[2], rtol=1e-13)
    again = pickle.loads(packed(problem))
    assert again.fingerprint() == problem.fingerprint()
    assert "s2mpjlib" not in "".join(sys.path)


def test_s2mpj_takes_arguments() -> None:
    problem = csw.Problem.from_s2mpj("ARGLALE", arguments=[10, 20])
    assert problem.nlp.sizes == (10, 0, 20)
    assert pickle.loads(packed(problem)).nlp.sizes == (10, 0, 20)


@pytest.mark.parametrize("name", ["NONE", "../HS71", "", "HS71.py"])
def test_unknown_name_of_s2mpj_is_refused(name: str) -> None:
    with pytest.raises(csw.ProblemError, match=f"S2MPJ has no problem '{name}'"):
        csw.Problem.from_s2mpj(name)


def test_arguments_without_a_name_are_refused() -> None:
    with pytest.raises(csw.ProblemError, match="arguments are for the name of a problem"):
        csw.Problem.from_s2mpj(HS71(), arguments=[1])


INTEGERS = {"pbclass": "I-COOR2-AY-4-2"}
REFUSED: list[tuple[Any, dict[str, Any], str]] = [
    (
        CUTEstProblem,
        {"vartype": [0, 2, 0, 0]},
        "'HS71' has integer variables; only continuous ones are supported",
    ),
    (CUTEstProblem, {"x0": np.array([1.0, np.nan, 1.0, 1.0])}, r"x0\[1\]"),
    (CUTEstProblem, {"bu": np.ones(4)}, "has no free variable"),
    (CUTEstProblem, {"bl": np.full(4, BIG)}, r"nothing is between lbx\[0\] = inf"),
    (HS71, INTEGERS, "'HS71' has the class I-COOR2-AY-4-2, with integer variables"),
    (HS71, {"conderlvl": [1]}, "'HS71' has no exact second derivatives"),
]


@pytest.mark.parametrize(("kind", "values", "message"), REFUSED)
def test_refusal_names_problem_and_reason(kind: Any, values: dict[str, Any], message: str) -> None:
    made = kind()
    vars(made).update(values)
    pose = csw.Problem.from_s2mpj if kind is HS71 else csw.Problem.from_pycutest
    with pytest.raises(csw.ProblemError, match=message):
        pose(made)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(csw.ProblemError, match="parameters N are for the name of a problem"):
        csw.Problem.from_pycutest(CUTEstProblem(), N=3)
    with pytest.raises(csw.ProblemError, match="3 is not a problem of PyCUTEst"):
        csw.Problem.from_pycutest(3)
    with pytest.raises(csw.ProblemError, match="not an instance of a problem's class"):
        csw.Problem.from_s2mpj(HS71)


def test_black_box_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(csw.ProblemError, match="HS71 cannot be written"):
        KINDS["s2mpj"]().to_nl(tmp_path / "problem.nl")


@pytest.mark.slow
def test_black_boxes_are_compared_with_their_copies() -> None:
    """In processes of the solvers, which import the module of the problem's class."""
    comparison = csw.compare(KINDS["s2mpj"](), ["ipopt", "slsqp"], copies=1)
    assert comparison.runs["solved"].all(), comparison.runs["message"].tolist()
    assert len(comparison.runs) == 4
