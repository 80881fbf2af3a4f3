"""Ipopt: published solutions, its words, its limits, its silence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import KNOWN, published
from known_problems import INF, Known, active_box, known, nearest_in_box

from casswarm.nlp import Nlp, Solution, Status
from casswarm.solvers import Ipopt
from casswarm.solvers import casadi_plugins as casadi_nlpsol

each = pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.nlp.name)

# every ApplicationReturnStatus of Ipopt (IpReturnCodes_inc.h), and what casswarm makes of it
WORDS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Search_Direction_Becomes_Too_Small": Status.FAILED,
    "Diverging_Iterates": Status.DIVERGED,
    "Feasible_Point_Found": Status.FAILED,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Restoration_Failed": Status.FAILED,
    "Error_In_Step_Computation": Status.FAILED,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
    "Not_Enough_Degrees_Of_Freedom": Status.FAILED,
    "Invalid_Problem_Definition": Status.FAILED,
    "Invalid_Option": Status.FAILED,
    "Invalid_Number_Detected": Status.FAILED,
    "Unrecoverable_Exception": Status.FAILED,
    "NonIpopt_Exception_Thrown": Status.FAILED,
    "Insufficient_Memory": Status.FAILED,
    "Internal_Error": Status.FAILED,
}


def solve(case: Known, solver: Ipopt | None = None, **changes: Any) -> Solution:
    return (solver or Ipopt()).solve(case.nlp, replace(case.instance, **changes))[0]


# --- published solutions


@each
@pytest.mark.parametrize("hessian", ["exact", "limited-memory"])
def test_ipopt_finds_published_solution(case: Known, hessian: Any) -> None:
    solution = solve(case, Ipopt(hessian=hessian))
    assert solution.status is Status.SOLVED
    assert solution.message == "Solve_Succeeded"
    assert solution.objective == pytest.approx(case.objective, rel=1e-7, abs=1e-7)
    np.testing.assert_allclose(solution.x, case.x, atol=1e-4 if hessian == "exact" else 1e-3)
    residuals = solution.residuals
    assert max(residuals.violation, residuals.complementarity) < 1e-6
    assert residuals.stationarity < 1e-5


@pytest.mark.parametrize("hessian", ["exact", "limited-memory"])
def test_ipopt_evaluates_hessian_only_if_exact(hessian: Any) -> None:
    case, solver = published(71), Ipopt(hessian=hessian)
    solve(case, solver)
    calls = casadi_nlpsol._compiled(solver, case.nlp).stats().get("n_call_nlp_hess_l", 0)
    assert (calls > 0) == (hessian == "exact")


@each
def test_ipopt_unrolled_expressions_give_same_solution(case: Known) -> None:
    unrolled = replace(case, nlp=replace(case.nlp, unroll=True))
    np.testing.assert_allclose(solve(unrolled).x, solve(case).x, atol=1e-6)


@pytest.mark.parametrize("case", [active_box(), *map(published, (1, 21, 71))])
def test_ipopt_answers_respect_bounds_exactly(case: Known) -> None:
    x = solve(case).x
    assert (case.instance.lbx[0] <= x).all()
    assert (x <= case.instance.ubx[0]).all()


def test_ipopt_tighter_tolerance_reduces_error() -> None:
    case = published(35)
    errors = [
        np.abs(solve(case, Ipopt(tolerance=tolerance)).x - case.x).max()
        for tolerance in (1e-2, 1e-6, 1e-12)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-8


def test_ipopt_fixed_variable_keeps_value_and_multiplier() -> None:
    case = published(35)
    fixed = np.array([[1.0, 0, 0]])
    upper = np.array([[1.0, INF, INF]])
    solution = solve(case, lbx=fixed, ubx=upper)
    assert solution.status is Status.SOLVED
    assert solution.x[0] == 1
    assert solution.residuals.stationarity < 1e-6


def test_ipopt_new_parameters_do_not_rebuild() -> None:
    x, q = ca.MX.sym("x", 2), ca.MX.sym("q", 2)
    nlp = Nlp("nearest on circle", {"x": x}, {"q": q}, ca.sumsqr(x - q), {"circle": ca.sumsqr(x)})
    case = active_box()
    goals = np.array([[3.0, 4.0], [0.3, -0.4], [-6.0, 8.0]])
    wide = np.full((3, 2), INF)
    instances = replace(
        case.instance,
        x0=np.ones((3, 2)),
        p=goals,
        lbx=-wide,
        ubx=wide,
        lbg=np.ones((3, 1)),
        ubg=np.ones((3, 1)),
    )
    solutions = Ipopt().solve(nlp, instances)
    expected = goals / np.linalg.norm(goals, axis=1, keepdims=True)
    np.testing.assert_allclose([s.x for s in solutions], expected, atol=1e-7)
    assert [s.message for s in solutions] == ["Solve_Succeeded"] * 3
    built = casadi_nlpsol._compiled.cache_info().misses
    Ipopt().solve(nlp, instances[1:])
    assert casadi_nlpsol._compiled.cache_info().misses == built


# --- words


class Spoken:
    """What CasADi's nlpsol returns, with a return_status of choice and the solution of HS 35."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __call__(self, **_: object) -> dict[str, ca.DM]:
        case = published(35)
        return {"x": ca.DM(case.x), "lam_x": ca.DM.zeros(3), "lam_g": ca.DM([2 / 9])}

    def stats(self) -> dict[str, object]:
        # CasADi's own judgement is not to be relied on
        unified = {"success": True, "unified_return_status": "SOLVER_RET_SUCCESS"}
        return {"return_status": self.words, "iter_count": 5, "n_call_nlp_f": 6} | unified


@pytest.mark.parametrize("words", [*WORDS, "Unknown_Word", ""])
def test_ipopt_return_status_maps_to_status(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(casadi_nlpsol, "_compiled", lambda solver, nlp: Spoken(words))  # noqa: ARG005
    solution = solve(published(35))
    assert solution.status is WORDS.get(words, Status.FAILED)
    assert solution.message == words
    assert (solution.iterations, solution.evaluations) == (5, 6)


def test_ipopt_status_table_contains_only_known_statuses() -> None:
    assert set(Ipopt.statuses) <= set(WORDS)


# --- limits and failures


def test_ipopt_time_limit_is_not_success() -> None:
    solution = solve(published(71), Ipopt(time_limit=1e-9))
    assert solution.status is Status.TIME_LIMIT
    assert solution.message == "Maximum_WallTime_Exceeded"


@pytest.mark.parametrize("iterations", [0, 1, 5])
def test_ipopt_respects_max_iter(iterations: int) -> None:
    solution = solve(published(1), Ipopt(max_iter=iterations))
    assert solution.status is Status.ITERATION_LIMIT
    assert solution.iterations == iterations


def test_ipopt_reports_infeasible_problem() -> None:
    far: dict[str, Any] = {"lbx": np.array([[2.0, 2, 2]]), "ubx": np.array([[5.0, 5, 5]])}
    solution = solve(published(35), **far)
    assert solution.status is Status.INFEASIBLE
    assert solution.message == "Infeasible_Problem_Detected"
    assert solution.residuals.violation == pytest.approx(5, abs=1e-4)
    assert solution.residuals.violated_row == "budget[0]"


def test_ipopt_unbounded_problem_diverges() -> None:
    case = known("downhill", lambda x: -x[0], ([INF], -INF), [0])
    solution = solve(case)
    assert solution.status is Status.DIVERGED
    assert solution.message == "Diverging_Iterates"


@pytest.mark.parametrize("changes", [{"lbx": np.nan}, {"ubg": np.nan}, {"x0": np.nan}])
def test_ipopt_nan_bounds_or_x0_fail_without_raising(changes: dict[str, float]) -> None:
    case = published(35)
    arrays = {name: np.full_like(getattr(case.instance, name), v) for name, v in changes.items()}
    solution = solve(case, **arrays)
    assert solution.status is Status.FAILED
    assert solution.message


def test_ipopt_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    solve(published(71))
    solve(published(71), Ipopt(max_iter=2))
    solve(published(71), Ipopt(time_limit=1e-9))
    solve(published(35), lbx=np.full((1, 3), 2.0))
    solve(known("root", lambda x: ca.sqrt(x[0] - 9), ([9], 0), [0]))
    Ipopt().solve(*nearest_in_box(np.full((1, 2), np.nan)))
    assert capfd.readouterr() == ("", "")
