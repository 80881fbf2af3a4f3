"""Problems of one's own: CasADi's dictionaries, Opti stacks and .nl files."""

from __future__ import annotations

import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import MORE, dictionary, published, stack

import casswarm as csw
from casswarm.solvers import Ipopt

X = ca.SX.sym("x", 2)
NLP = {"x": X, "f": ca.sumsqr(X), "g": X[0] + X[1]}
TEN = (10, 12, 14, 18, 22, 29, 39, 43, 76, 100)
"""Numbers of Hock and Schittkowski whose minimum every solver finds from the start."""


def answer(problem: csw.Problem) -> csw.Solution:
    return Ipopt().solve(problem.nlp, problem.starts["given"])[0]


OTHER = {55}
"""Problems of which Ipopt finds another minimum from the book's start, in every form."""

FORMS = [number for number in (*TEN, *MORE) if number != 44]
"""Of problem 44, it finds different minima in different forms."""


@pytest.mark.parametrize("number", FORMS)
def test_problem_has_the_same_answer_in_every_form(tmp_path: Path, number: int) -> None:
    problem = dictionary(number)
    problem.to_nl(tmp_path / "problem.nl")
    read = csw.Problem.from_nl(tmp_path / "problem.nl")
    assert read.name == "problem"
    expected = answer(problem)
    stated = published(number)
    optimum = stated.local[0] if number in OTHER else stated.objective
    assert expected.objective == pytest.approx(optimum, rel=1e-6, abs=1e-6)
    for again in (stack(number), read, pickle.loads(pickle.dumps(problem))):
        solution = answer(again)
        assert solution.status.success
        assert solution.objective == pytest.approx(expected.objective, rel=1e-7, abs=1e-8)
        np.testing.assert_allclose(solution.x, expected.x, rtol=1e-5, atol=1e-5)


def test_from_casadi_takes_scalars_parameters_and_several_starts() -> None:
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    nlp = {"x": x, "p": p, "f": ca.sumsqr(x - p), "g": ca.sum1(x)}
    problem = csw.Problem.from_casadi(nlp, x0={"a": 0, "b": [3, 4]}, p=[1, 2], lbg=-1, lbx=-9)
    assert list(problem.starts) == ["a", "b"]
    near = problem.starts["b"]
    assert near.x0.tolist() == [[3, 4]]
    assert near.lbx.tolist() == [[-9, -9]]
    assert near.ubg.tolist() == [[np.inf]]
    f, g = problem.nlp.evaluate([3, 4], [1, 2])
    assert (float(f), float(g)) == (8, 7)


def test_from_opti_takes_parameters_guesses_and_bounds() -> None:
    opti = ca.Opti()
    x, y, p = opti.variable(2), opti.variable(), opti.parameter()
    opti.minimize(p * y)
    opti.subject_to(x[0] + y >= p)
    opti.set_value(p, 3)
    opti.set_initial(x, [1, 2])
    problem = csw.Problem.from_opti(opti, "stack")
    instance = problem.starts["given"]
    assert instance.x0.tolist() == [[1, 2, 0]]
    assert (instance.lbg.tolist(), instance.ubg.tolist()) == ([[3]], [[np.inf]])
    assert float(problem.nlp.evaluate([0, 0, 5], instance.p[0])[0]) == 15


def test_written_parameters_are_numbers(tmp_path: Path) -> None:
    nlp = {"x": X, "p": (p := ca.SX.sym("p")), "f": p * X[0] ** 2}
    problem = csw.Problem.from_casadi(nlp, x0={"one": 1, "two": 2}, p=7)
    problem.to_nl(tmp_path / "a.nl", "two")
    read = csw.Problem.from_nl(tmp_path / "a.nl")
    assert read.starts["given"].x0.tolist() == [[2, 2]]
    assert float(read.nlp.evaluate([1, 0], [])[0]) == 7
    with pytest.raises(csw.ProblemError, match="no start 'three'; it has one, two"):
        problem.to_nl(tmp_path / "a.nl", "three")


REFUSED = {
    "no bounds": (NLP, {}, "constraints g without bounds; give lbg, ubg or both"),
    "nan start": (NLP, {"lbg": 0, "x0": [1, np.nan]}, r"x0\[1\] is not a number"),
    "infinite start": (NLP, {"lbg": 0, "x0": np.inf}, "x0 is not finite"),
    "fixed": (NLP, {"lbg": 0, "lbx": 1, "ubx": 1}, "has no free variable: lbx = ubx everywhere"),
    "crossed": (NLP, {"lbg": 2, "ubg": 1}, r"nothing is between lbg\[0\] = 2 and ubg\[0\] = 1"),
    "size": (NLP, {"lbg": 0, "x0": [1, 2, 3]}, "x0 has 3 entries; expected one or 2"),
    "text": (NLP, {"lbg": 0, "lbx": "low"}, "lbx = 'low' are no numbers"),
    "no starts": (NLP, {"lbg": 0, "x0": {}}, "has no initial guess"),
    "misspelt": (NLP, {"lbgg": 0}, "'lbgg' is unknown; did you mean 'lbg'"),
    "entry": (NLP | {"h": X}, {"lbg": 0}, "'h' is unknown"),
    "objective": ({"x": X, "f": ca.log(X[0])}, {}, "given start: the objective is -inf at x0"),
    "row": ({"x": X, "g": 1 / X}, {"lbg": 0}, r"given start: g\[0\] is inf at x0"),
    "vector": ({"x": X, "f": X}, {}, "f has 2 entries; expected a scalar"),
    "free symbol": ({"x": X, "f": ca.SX.sym("y")}, {}, r"variables \[y\] are free"),
    "not symbols": ({"x": 2 * X, "f": X[0]}, {}, "must be purely symbolic"),
    "mixed": ({"x": X, "f": ca.MX.sym("y")}, {}, "f is of MX, but x of SX"),
    "numbers": ({"x": [1, 2]}, {}, "x has to be symbols of CasADi"),
    "nothing": ({"x": ca.SX(0, 1)}, {}, "has no variables"),
    "no value": (NLP | {"p": ca.SX.sym("p")}, {"lbg": 0}, "parameters without values; give p"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_from_casadi_refusal_names_problem_and_reason(name: str) -> None:
    nlp, arguments, reason = REFUSED[name]
    with pytest.raises(csw.ProblemError, match=f"problem 'mine'.*{reason}"):
        csw.Problem.from_casadi(nlp, "mine", **arguments)


def test_from_opti_refuses_integers_and_missing_values() -> None:
    opti = ca.Opti()
    x, p = opti.variable(), opti.parameter()
    opti.minimize(x**2 + p)
    with pytest.raises(csw.ProblemError, match="parameter with unset value"):
        csw.Problem.from_opti(opti)
    opti.set_value(p, 1)
    opti.set_domain(x, "integer")
    with pytest.raises(csw.ProblemError, match="integer variables"):
        csw.Problem.from_opti(opti)


def test_from_nl_names_file_of_unsolvable_problem(tmp_path: Path) -> None:
    path = tmp_path / "log.nl"
    csw.Problem.from_casadi({"x": X, "f": ca.log(X[0])}, x0=1).to_nl(path)
    path.write_text(path.read_text().replace("x2\n0 1", "x2\n0 0"))
    with pytest.raises(csw.ProblemError, match=r"log\.nl: problem 'log'.*objective is -inf"):
        csw.Problem.from_nl(path)


@pytest.mark.parametrize(
    ("given", "call"),
    [
        (ca.Opti(), r"Problem\.from_opti\(opti\)"),
        ([ca.Opti()], r"Problem\.from_opti\(opti\)"),
        (csw.load_scenario("paper-1"), r"guide_problems\(scenario\)"),
        ([3.0], r"read_problems"),
    ],
)
def test_comparison_of_what_is_no_problem_says_what_to_call(given: object, call: str) -> None:
    with pytest.raises(TypeError, match=call):
        csw.compare(given, ["ipopt"])


def test_problems_are_read_from_one_path(tmp_path: Path) -> None:
    path = tmp_path / "own.nl"
    csw.Problem.from_casadi(NLP, lbg=1).to_nl(path)
    assert [
        problem.name for given in (path, str(path)) for problem in csw.read_problems(given)
    ] == [
        "own",
        "own",
    ]
