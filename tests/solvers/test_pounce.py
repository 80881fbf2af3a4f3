"""POUNCE, an optional solver: its statuses, its units, and what happens without the package."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import published

from casswarm.errors import SolverError
from casswarm.nlp import Instances, LagrangianHessian, Nlp, Status
from casswarm.solvers import Pounce, make_solver
from casswarm.solvers import external as pounce

STATUSES = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
    "Diverging_Iterates": Status.DIVERGED,
    "Feasible_Point_Found": Status.FAILED,
    "Search_Direction_Becomes_Too_Small": Status.FAILED,
    "User_Requested_Stop": Status.FAILED,
    "Restoration_Failed": Status.FAILED,
    "Error_In_Step_Computation": Status.FAILED,
    "Not_Enough_Degrees_Of_Freedom": Status.FAILED,
    "Invalid_Problem_Definition": Status.FAILED,
    "Invalid_Option": Status.FAILED,
    "Invalid_Number_Detected": Status.FAILED,
    "Callback_Error": Status.FAILED,
    "Unrecoverable_Exception": Status.FAILED,
    "NonIpopt_Exception_Thrown": Status.FAILED,
    "Insufficient_Memory": Status.FAILED,
    "Internal_Error": Status.FAILED,
    "A message of a later version": Status.FAILED,
}
"""Every message of version 0.13, and one that it does not have."""

needs_package = pytest.mark.skipif(bool(Pounce.unavailable()), reason=Pounce.unavailable())


@pytest.mark.parametrize("message", STATUSES)
def test_message_has_status(message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = published(71)

    class Fake:
        def __init__(self, **given: Any) -> None:
            self.given = given

        def add_option(self, *_: object) -> None:
            pass

        def solve(self, _: object) -> tuple[object, dict[str, object]]:
            counts = {"iter_count": 3, "n_obj_evals": 4}
            multipliers = dict.fromkeys(("mult_x_L", "mult_x_U"), np.zeros(4))
            return case.x, {"status_msg": message, "mult_g": np.zeros(2), **counts, **multipliers}

    monkeypatch.setattr(pounce, "_package", lambda: SimpleNamespace(Problem=Fake))
    (answer,) = Pounce().run(case.nlp, case.instance)
    assert (answer.status, answer.message) == (STATUSES[message], message)
    assert (answer.iterations, answer.evaluations) == (3, 4)


def test_missing_package_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(pounce, "version", missing)
    with pytest.raises(SolverError, match=r"'pounce' cannot run here: .*casswarm\[pounce\]"):
        make_solver("pounce")
    case = published(71)
    with pytest.raises(SolverError, match="pounce-solver is not installed"):
        Pounce().solve(case.nlp, case.instance)


def program(objective: Any, rows: Any, x: Any, bounds: tuple[float, float]) -> tuple[Nlp, Any]:
    nlp = Nlp.from_expressions("own", x, ca.SX(0, 1), objective, rows)
    size, count = x.numel(), ca.SX(rows).numel()
    wide, none = np.full((1, size), np.inf), np.zeros((1, 0))
    low, high = (np.full((1, count), bound) for bound in bounds)
    return nlp, Instances(np.ones((1, size)), none, -wide, wide, low, high)


@needs_package
def test_infeasible_and_unbounded_problems_are_no_success() -> None:
    x = ca.SX.sym("x", 2)
    (none,) = Pounce().solve(*program(x[0], ca.sumsqr(x), x, (-np.inf, -1.0)))
    assert none.status is Status.INFEASIBLE
    (endless,) = Pounce().solve(*program(x[0] - x[1] ** 3, x[0], x, (-np.inf, np.inf)))
    assert not endless.status.success
    assert endless.message in STATUSES


@needs_package
@pytest.mark.parametrize("case", [published(35), published(71)], ids=["inequality", "equality"])
def test_answer_does_not_depend_on_scale(case: Any) -> None:
    (solution,) = Pounce().solve(case.nlp, case.instance)
    scaled = replace(case.instance, scale=np.array([[4.0, 0.25]]))
    (answer,) = Pounce().run(case.nlp, scaled)
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(answer.x, solution.x, atol=1e-6)
    assert answer.multipliers is not None
    for found, known in zip(
        answer.multipliers, (case.bound_multipliers, case.row_multipliers), strict=True
    ):
        np.testing.assert_allclose(found, known, atol=2e-4)


@needs_package
def test_own_hessian_is_used() -> None:
    """A program's own Hessian, in units of the scale, leads to the same steps as derivatives."""
    case = published(35)
    x, lam_f = ca.MX.sym("x", 3), ca.MX.sym("lam_f")
    p, lam_g = ca.MX.sym("p", 0), ca.MX.sym("lam_g", 1)
    f = case.nlp.evaluate.call([x, p], True, False)[0]
    calls = [ca.triu(ca.hessian(lam_f * f, x)[0])]
    hessian = ca.Function("own", [x, p, lam_f, lam_g], calls)
    own = case.nlp.with_attachments(LagrangianHessian(hessian))
    scaled = replace(case.instance, scale=np.array([[2.0, 3.0]]))
    (derived,), (given,) = (Pounce().run(nlp, scaled) for nlp in (case.nlp, own))
    assert given.iterations == derived.iterations
    np.testing.assert_allclose(given.x, derived.x, rtol=1e-12)


@needs_package
def test_options_may_be_whole_numbers() -> None:
    case = published(35)
    solver = Pounce(time_limit=5, mu_init=1)
    assert solver.solve(case.nlp, case.instance)[0].status is Status.SOLVED


@needs_package
@pytest.mark.slow
def test_log_of_the_package_is_not_printed() -> None:
    """A problem about which it would write a line, in a process that imports it first."""
    script = """
import casadi as ca, casswarm as csw
x = ca.SX.sym("x", 2)
nlp = {"x": x, "f": 1e6 * (x[0] - 1) ** 4 + x[1] ** 2}
problem = csw.Problem.from_casadi(nlp, x0=[50, 3])
print(csw.solvers.Pounce().solve(problem.nlp, problem.starts["given"])[0].status)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("solved\n", "")
