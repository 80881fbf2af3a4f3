"""Ipopt, POUNCE, Uno's package, any plugin of CasADi, and any function like SciPy's minimize."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from available_solvers import each, needs
from commands import python
from hock_schittkowski import KNOWN, published
from known_problems import INF, Known, active_box, instances, known, nearest_in_box
from scipy.optimize import OptimizeResult, minimize

from casswarm.errors import SolverError
from casswarm.nlp import LagrangianHessian, Nlp, Solution, Status
from casswarm.solvers import (
    Ipopt,
    Minimize,
    NlpSol,
    Pounce,
    Unopy,
    casadi_plugins,
    external,
    make_solver,
)
from casswarm.typing import FloatArray

every_known = pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.nlp.name)

FAILURES = """
    Search_Direction_Becomes_Too_Small Feasible_Point_Found Restoration_Failed Internal_Error
    Error_In_Step_Computation Not_Enough_Degrees_Of_Freedom Invalid_Problem_Definition
    Invalid_Option Invalid_Number_Detected Unrecoverable_Exception NonIpopt_Exception_Thrown
    Insufficient_Memory
"""
WORDS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Diverging_Iterates": Status.DIVERGED,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
} | dict.fromkeys(FAILURES.split(), Status.FAILED)
"""Every ApplicationReturnStatus of Ipopt (IpReturnCodes_inc.h), and what casswarm makes of it."""

POUNCE_WORDS = WORDS | dict.fromkeys(
    ("User_Requested_Stop", "Callback_Error", "A message of a later version"), Status.FAILED
)
"""Every message of POUNCE 0.13, and one that it does not have."""

POINTS = {
    "FEASIBLE_KKT_POINT": Status.SOLVED,
    "INFEASIBLE_STATIONARY_POINT": Status.INFEASIBLE,
    "UNBOUNDED_OBJECTIVE": Status.DIVERGED,
    "DIVERGING_ITERATE": Status.DIVERGED,
} | dict.fromkeys(
    ("FEASIBLE_FJ_POINT", "FEASIBLE_SMALL_STEP", "INFEASIBLE_SMALL_STEP", "NOT_OPTIMAL"),
    Status.FAILED,
)
ENDS = {
    "ITERATION_LIMIT": Status.ITERATION_LIMIT,
    "TIME_LIMIT": Status.TIME_LIMIT,
} | dict.fromkeys(
    ("EVALUATION_ERROR", "ALGORITHMIC_ERROR", "USER_INTERRUPTION", "USER_TERMINATION"),
    Status.FAILED,
)
"""Uno's names of the point that it returns, and of the ways in which it ends without success."""


def solve(case: Known, solver: Any = None, **changes: Any) -> Solution:
    return (solver or Ipopt()).solve(case.nlp, replace(case.instance, **changes))[0]


# --- published solutions


@every_known
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
    calls = casadi_plugins._compiled(solver, case.nlp).stats().get("n_call_nlp_hess_l", 0)
    assert (calls > 0) == (hessian == "exact")


@every_known
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
    solution = solve(published(35), lbx=np.array([1.0, 0, 0]), ubx=np.array([1.0, INF, INF]))
    assert solution.status is Status.SOLVED
    assert solution.x[0] == 1
    assert solution.residuals.stationarity < 1e-6


def test_ipopt_new_parameters_do_not_rebuild() -> None:
    x, q = ca.MX.sym("x", 2), ca.MX.sym("q", 2)
    nlp = Nlp("nearest on circle", {"x": x}, {"q": q}, ca.sumsqr(x - q), {"circle": ca.sumsqr(x)})
    goals = np.array([[3.0, 4.0], [0.3, -0.4], [-6.0, 8.0]])
    batch = instances(np.ones((3, 2)), goals, lbg=1.0, ubg=1.0)
    solutions = Ipopt().solve(nlp, batch)
    expected = goals / np.linalg.norm(goals, axis=1, keepdims=True)
    np.testing.assert_allclose([s.x for s in solutions], expected, atol=1e-7)
    assert [s.message for s in solutions] == ["Solve_Succeeded"] * 3
    built = casadi_plugins._compiled.cache_info().misses
    Ipopt().solve(nlp, batch[1:])
    assert casadi_plugins._compiled.cache_info().misses == built


@needs("unopy")
@pytest.mark.parametrize("number", [12, 43, 76, 100])
def test_unopy_answer_equals_that_of_casadis_interface(number: int) -> None:
    ours, theirs = (solve(published(number), make_solver(name)) for name in ("unopy", "uno"))
    np.testing.assert_allclose(ours.x, theirs.x, rtol=1e-6, atol=1e-6)


# --- statuses


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
    monkeypatch.setattr(casadi_plugins, "_compiled", lambda solver, nlp: Spoken(words))  # noqa: ARG005
    solution = solve(published(35))
    assert solution.status is WORDS.get(words, Status.FAILED)
    assert solution.message == words
    assert (solution.iterations, solution.evaluations) == (5, 6)


def test_ipopt_status_table_contains_only_known_statuses() -> None:
    assert set(Ipopt.statuses) <= set(WORDS)


@pytest.mark.parametrize("message", POUNCE_WORDS)
def test_pounce_message_has_status(message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = published(71)

    class Fake:
        def __init__(self, **_: Any) -> None:
            pass

        def add_option(self, *_: object) -> None:
            pass

        def solve(self, _: object) -> tuple[object, dict[str, object]]:
            counts = {"iter_count": 3, "n_obj_evals": 4}
            multipliers = dict.fromkeys(("mult_x_L", "mult_x_U"), np.zeros(4))
            return case.x, {"status_msg": message, "mult_g": np.zeros(2), **counts, **multipliers}

    monkeypatch.setattr(external, "_package", lambda: SimpleNamespace(Problem=Fake))
    (answer,) = Pounce().run(case.nlp, case.instance)
    assert (answer.status, answer.message) == (POUNCE_WORDS[message], message)
    assert (answer.iterations, answer.evaluations) == (3, 4)


@pytest.mark.parametrize("point", [*POINTS, "NAME_OF_A_LATER_VERSION"])
def test_unopy_point_has_status_only_after_success(point: str) -> None:
    assert Unopy().status("SUCCESS", point) is POINTS.get(point, Status.FAILED)
    assert Unopy().status("ALGORITHMIC_ERROR", point) is Status.FAILED


@pytest.mark.parametrize("end", [*ENDS, "NAME_OF_A_LATER_VERSION"])
def test_unopy_end_without_success_has_status(end: str) -> None:
    assert Unopy().status(end, "FEASIBLE_KKT_POINT") is ENDS.get(end, Status.FAILED)


@needs("unopy")
def test_ctrl_c_after_last_step_of_uno_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Uno's own handler of SIGINT is looked at between its steps only."""
    nlp, instance = active_box().nlp, active_box().instance
    last = Unopy().solve(nlp, instance)[0].evaluations
    objective = external.InstanceFunctions.objective

    def interrupted(functions: external.InstanceFunctions, x: FloatArray) -> float:
        value = objective(functions, x)
        if functions.evaluations == last:
            signal.raise_signal(signal.SIGINT)
        return value

    monkeypatch.setattr(external.InstanceFunctions, "objective", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Unopy().solve(nlp, instance)


@needs("unopy")
def test_unopy_tables_have_every_name_of_the_package() -> None:
    import unopy

    assert set(unopy.SolutionStatus.__members__) == set(POINTS)
    assert set(unopy.OptimizationStatus.__members__) == {"SUCCESS", *ENDS}


# --- limits and failures


DOWNHILL = known("downhill", lambda x: -x[0], ([INF], -INF), [0])
FAR = {"lbx": np.full(3, 2.0), "ubx": np.full(3, 5.0)}
ENDINGS = [
    (published(71), Ipopt(time_limit=1e-9), {}, Status.TIME_LIMIT, "Maximum_WallTime_Exceeded"),
    (published(35), Ipopt(), FAR, Status.INFEASIBLE, "Infeasible_Problem_Detected"),
    (DOWNHILL, Ipopt(), {}, Status.DIVERGED, "Diverging_Iterates"),
    *(
        (published(1), Ipopt(max_iter=count), {}, Status.ITERATION_LIMIT, "Maximum_Iterations")
        for count in (0, 1, 5)
    ),
]


@pytest.mark.parametrize(("case", "solver", "changes", "status", "words"), ENDINGS)
def test_ipopt_ends_without_success(
    case: Known, solver: Ipopt, changes: dict[str, Any], status: Status, words: str
) -> None:
    solution = solve(case, solver, **changes)
    assert (solution.status, solution.message[: len(words)]) == (status, words)
    if status is Status.ITERATION_LIMIT:
        assert solution.iterations == solver.max_iter
    if status is Status.INFEASIBLE:
        assert solution.residuals.violation == pytest.approx(5, abs=1e-4)
        assert solution.residuals.violated_row == "budget[0]"


@pytest.mark.parametrize("name", each(["pounce", "unopy"]))
def test_optional_solver_reports_infeasible_problem(name: str) -> None:
    case = known(
        "none", lambda x: x[0], ([0, 0], 0), [1, 1], rows={"disc": (ca.sumsqr, -INF, -1.0)}
    )
    assert solve(case, make_solver(name)).status is Status.INFEASIBLE


@needs("pounce")
def test_pounce_unbounded_problem_is_no_success() -> None:
    row = {"row": (lambda x: x[0], -INF, INF)}
    case = known("downhill", lambda x: x[0] - x[1] ** 3, ([INF] * 2, -INF), [1, 1], rows=row)
    solution = solve(case, Pounce())
    assert not solution.status.success
    assert solution.message in POUNCE_WORDS


@pytest.mark.parametrize("name", ["lbx", "ubg", "x0"])
def test_ipopt_nan_bounds_or_x0_fail_without_raising(name: str) -> None:
    case = published(35)
    solution = solve(case, **{name: np.full_like(getattr(case.instance, name), np.nan)})
    assert solution.status is Status.FAILED
    assert solution.message


@pytest.mark.parametrize("name", ["pounce", "unopy"])
def test_missing_package_is_a_reason(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(package: str) -> str:
        raise PackageNotFoundError(package)

    monkeypatch.setattr(external, "version", missing)
    with pytest.raises(SolverError, match=rf"'{name}' cannot run here: .*casswarm\[{name}\]"):
        make_solver(name)
    kind, package = {"pounce": (Pounce, "pounce-solver"), "unopy": (Unopy, "unopy")}[name]
    with pytest.raises(SolverError, match=f"{package} is not installed"):
        solve(published(71), kind())


# --- units, options and silence


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param("pounce", {}, marks=needs("pounce")),
        pytest.param("unopy", {"preset": "filtersqp"}, marks=needs("unopy")),
        pytest.param("unopy", {"preset": "ipopt"}, marks=needs("unopy")),
    ],
)
@pytest.mark.parametrize("case", [published(35), published(71)], ids=["inequality", "equality"])
def test_answer_does_not_depend_on_scale(name: str, options: dict[str, Any], case: Known) -> None:
    scaled = replace(case.instance, scale=np.array([[4.0, 0.25]]))
    plain, other = (
        make_solver(name, **options).run(case.nlp, each)[0] for each in (case.instance, scaled)
    )
    np.testing.assert_allclose(other.x, plain.x, atol=1e-6)
    for answer in (plain, other):
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, case.x, atol=1e-5)
        np.testing.assert_allclose(answer.multipliers[0], case.bound_multipliers, atol=2e-4)
        np.testing.assert_allclose(answer.multipliers[1], case.row_multipliers, atol=2e-4)


@needs("pounce")
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


@pytest.mark.parametrize("name", each(["pounce", "unopy"]))
def test_options_may_be_whole_numbers(name: str) -> None:
    options = {"time_limit": 5} | ({"mu_init": 1} if name == "pounce" else {})
    assert solve(published(35), make_solver(name, **options)).status is Status.SOLVED


def test_ipopt_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    solve(published(71))
    solve(published(71), Ipopt(max_iter=2))
    solve(published(71), Ipopt(time_limit=1e-9))
    solve(published(35), lbx=np.full((1, 3), 2.0))
    solve(known("root", lambda x: ca.sqrt(x[0] - 9), ([9], 0), [0]))
    Ipopt().solve(*nearest_in_box(np.full((1, 2), np.nan)))
    assert capfd.readouterr() == ("", "")


@needs("unopy")
def test_row_without_bounds_is_no_output(capfd: pytest.CaptureFixture[str]) -> None:
    free = {"lbg": np.full(2, -INF), "ubg": np.full(2, INF)}
    assert solve(published(71), Unopy(), **free).status is Status.SOLVED
    assert capfd.readouterr() == ("", "")


@needs("pounce")
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
    done = python("-c", script, timeout=60)
    assert (done.stdout, done.stderr) == ("solved\n", "")


# --- any plugin of CasADi, and any function like SciPy's minimize


SOLVERS = {
    "plugin": NlpSol("ipopt", {"ipopt": {"tol": 1e-9, "print_level": 0}}),
    "slsqp": Minimize(minimize, {"method": "SLSQP"}),
}


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("number", [14, 18, 35, 43, 71])
def test_solver_finds_published_optimum(name: str, number: int) -> None:
    case = published(number)
    solution = solve(case, pickle.loads(pickle.dumps(SOLVERS[name])))
    assert solution.status is Status.SOLVED
    assert solution.objective == pytest.approx(case.objective, rel=1e-5)
    assert solution.solver == ("ipopt" if name == "plugin" else "minimize")


def test_nlpsol_status_is_that_of_casadi() -> None:
    options = {"ipopt": {"max_iter": 1, "print_level": 0}}
    assert solve(published(71), NlpSol("ipopt", options)).status is Status.ITERATION_LIMIT


def test_nlpsol_rejects_unknown_plugin_and_option() -> None:
    with pytest.raises(SolverError, match="nosuch cannot run here: the nlpsol plugin 'nosuch'"):
        solve(published(35), NlpSol("nosuch"))
    with pytest.raises(SolverError, match="cannot solve HS 35"):
        solve(published(35), NlpSol("ipopt", {"nosuch": 1}))


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

    solution = solve(case, Minimize(inspect, {"extra": 3}))
    assert given == {"extra": 3, "kinds": ["eq", "ineq"], "values": [[0], [0]]}
    assert (solution.status, solution.message) == (Status.SOLVED, "bytes")
    assert (solution.iterations, solution.solver) == (0, "inspect")


def test_minimize_failure_and_time_limit_are_statuses() -> None:
    def endless(fun, x0, **_):
        while True:
            fun(x0)

    solution = solve(published(35), Minimize(endless, time_limit=0.05))
    assert solution.status is Status.TIME_LIMIT
    solution = solve(published(35), Minimize(lambda *_, **__: 1 / 0))
    assert solution.status is Status.FAILED
    assert "ZeroDivisionError" in solution.message


def test_plugin_by_name_equals_its_class() -> None:
    named, own = (solve(published(71), by) for by in (SOLVERS["plugin"], Ipopt(tolerance=1e-9)))
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
    assert len(seen) > 3
    np.testing.assert_array_equal(iterates.x[1:], seen)


def test_callback_can_stop_a_solve_whose_iterates_are_recorded() -> None:
    def stop(x: FloatArray) -> None:  # noqa: ARG001
        raise StopIteration

    case = published(1)
    iterates = lbfgsb(stop).iterates(case.nlp, case.instance)
    assert iterates.numbers.tolist() == [0, 1]
