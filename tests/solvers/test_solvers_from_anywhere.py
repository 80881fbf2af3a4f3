"""Any plugin of CasADi, and any function like SciPy's minimize, as a solver."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from hock_schittkowski import published
from scipy.optimize import OptimizeResult, minimize

from casswarm.errors import SolverError
from casswarm.nlp import Status
from casswarm.solvers import Ipopt, Minimize, NlpSol
from casswarm.typing import FloatArray

SOLVERS = {
    "plugin": NlpSol("ipopt", {"ipopt": {"tol": 1e-9, "print_level": 0}}),
    "slsqp": Minimize(minimize, {"method": "SLSQP"}),
}


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("number", [14, 18, 35, 43, 71])
def test_solver_finds_published_optimum(name: str, number: int) -> None:
    case, solver = published(number), pickle.loads(pickle.dumps(SOLVERS[name]))
    solution = solver.solve(case.nlp, case.instance)[0]
    assert solution.status is Status.SOLVED
    assert solution.objective == pytest.approx(case.objective, rel=1e-5)
    assert solution.solver == ("ipopt" if name == "plugin" else "minimize")


def test_nlpsol_status_is_that_of_casadi() -> None:
    case = published(71)
    options = {"ipopt": {"max_iter": 1, "print_level": 0}}
    solution = NlpSol("ipopt", options).solve(case.nlp, case.instance)[0]
    assert solution.status is Status.ITERATION_LIMIT


def test_nlpsol_rejects_unknown_plugin_and_option() -> None:
    case = published(35)
    with pytest.raises(SolverError, match="nosuch cannot run here: the nlpsol plugin 'nosuch'"):
        NlpSol("nosuch").solve(case.nlp, case.instance)
    with pytest.raises(SolverError, match="cannot solve HS 35"):
        NlpSol("ipopt", {"nosuch": 1}).solve(case.nlp, case.instance)


def test_minimize_passes_functions_bounds_and_constraints() -> None:
    case = published(71)
    given = {}

    def inspect(fun, x0, jac, bounds, constraints, **options):
        given.update(options, kinds=[part["type"] for part in constraints])
        x = case.x
        for part in constraints:
            given.setdefault("values", []).append(np.round(part["fun"](x), 4).tolist())
            assert part["jac"](x).shape == (1, 4)
        assert x0.tolist() == [1, 5, 5, 1]
        assert bounds.lb.tolist() == [1] * 4
        assert jac(x).shape == (4,)
        return SimpleNamespace(x=x, success=True, message=b"bytes", fun=fun(x))

    solution = Minimize(inspect, {"extra": 3}).solve(case.nlp, case.instance)[0]
    assert given == {"extra": 3, "kinds": ["eq", "ineq"], "values": [[0], [0]]}
    assert (solution.status, solution.message) == (Status.SOLVED, "bytes")
    assert (solution.iterations, solution.solver) == (0, "inspect")


def test_minimize_failure_and_time_limit_are_statuses() -> None:
    case = published(35)

    def endless(fun, x0, **_):
        while True:
            fun(x0)

    solution = Minimize(endless, time_limit=0.05).solve(case.nlp, case.instance)[0]
    assert solution.status is Status.TIME_LIMIT
    solution = Minimize(lambda *_, **__: 1 / 0).solve(case.nlp, case.instance)[0]
    assert solution.status is Status.FAILED
    assert "ZeroDivisionError" in solution.message


def test_plugin_by_name_equals_its_class() -> None:
    case = published(71)
    named = SOLVERS["plugin"].solve(case.nlp, case.instance)[0]
    own = Ipopt(tolerance=1e-9).solve(case.nlp, case.instance)[0]
    np.testing.assert_allclose(named.x, own.x, rtol=1e-6)


# --- callbacks of the user


def lbfgsb(callback: Callable[..., None]) -> Minimize:
    return Minimize(minimize, {"method": "L-BFGS-B", "callback": callback})


@pytest.mark.parametrize("signature", ["x", "intermediate_result"])
def test_callback_is_called_beside_the_recording_of_iterates(signature: str) -> None:
    seen = []

    def of_point(x: FloatArray) -> None:
        seen.append(np.array(x))

    def of_result(*, intermediate_result: OptimizeResult) -> None:
        seen.append(np.array(intermediate_result.x))

    case = published(1)
    solver = lbfgsb(of_point if signature == "x" else of_result)
    iterates = solver.iterates(case.nlp, case.instance)
    assert iterates is not None
    assert len(seen) > 3
    np.testing.assert_array_equal(iterates.x[1:], seen)


def test_callback_can_stop_a_solve_whose_iterates_are_recorded() -> None:
    def stop(x: FloatArray) -> None:  # noqa: ARG001
        raise StopIteration

    case = published(1)
    iterates = lbfgsb(stop).iterates(case.nlp, case.instance)
    assert iterates is not None
    assert iterates.numbers.tolist() == [0, 1]
