"""Uno's own package, an optional solver: its statuses, presets, units, and agreement with `uno`."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import published

from casswarm.errors import SolverError
from casswarm.nlp import Instances, Nlp, Status
from casswarm.solvers import Unopy, make_solver
from casswarm.solvers import external as unopy

needs_package = pytest.mark.skipif(bool(Unopy.unavailable()), reason=Unopy.unavailable())

POINTS = {
    "FEASIBLE_KKT_POINT": Status.SOLVED,
    "INFEASIBLE_STATIONARY_POINT": Status.INFEASIBLE,
    "UNBOUNDED_OBJECTIVE": Status.DIVERGED,
    "DIVERGING_ITERATE": Status.DIVERGED,
    "FEASIBLE_FJ_POINT": Status.FAILED,
    "FEASIBLE_SMALL_STEP": Status.FAILED,
    "INFEASIBLE_SMALL_STEP": Status.FAILED,
    "NOT_OPTIMAL": Status.FAILED,
}
ENDS = {
    "ITERATION_LIMIT": Status.ITERATION_LIMIT,
    "TIME_LIMIT": Status.TIME_LIMIT,
    "EVALUATION_ERROR": Status.FAILED,
    "ALGORITHMIC_ERROR": Status.FAILED,
    "USER_INTERRUPTION": Status.FAILED,
    "USER_TERMINATION": Status.FAILED,
}


@pytest.mark.parametrize("point", [*POINTS, "NAME_OF_A_LATER_VERSION"])
def test_point_has_status_only_after_success(point: str) -> None:
    assert Unopy().status("SUCCESS", point) is POINTS.get(point, Status.FAILED)
    assert Unopy().status("ALGORITHMIC_ERROR", point) is Status.FAILED


@pytest.mark.parametrize("end", [*ENDS, "NAME_OF_A_LATER_VERSION"])
def test_end_without_success_has_status(end: str) -> None:
    assert Unopy().status(end, "FEASIBLE_KKT_POINT") is ENDS.get(end, Status.FAILED)


@needs_package
def test_tables_have_every_name_of_the_package() -> None:
    import unopy as package

    for kind, known in (
        (package.SolutionStatus, POINTS),
        (package.OptimizationStatus, {"SUCCESS", *ENDS}),
    ):
        assert set(kind.__members__) == set(known)


def test_missing_package_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(unopy, "version", missing)
    with pytest.raises(SolverError, match=r"'unopy' cannot run here: .*casswarm\[unopy\]"):
        make_solver("unopy")
    case = published(71)
    with pytest.raises(SolverError, match="unopy is not installed"):
        Unopy().solve(case.nlp, case.instance)


@needs_package
@pytest.mark.parametrize("preset", ["filtersqp", "ipopt"])
@pytest.mark.parametrize("case", [published(35), published(71)], ids=["inequality", "equality"])
def test_answer_does_not_depend_on_scale(preset: Any, case: Any) -> None:
    scaled = replace(case.instance, scale=np.array([[4.0, 0.25]]))
    for instance in (case.instance, scaled):
        (answer,) = Unopy(preset=preset).run(case.nlp, instance)
        assert answer.status is Status.SOLVED
        np.testing.assert_allclose(answer.x, case.x, atol=1e-5)
        assert answer.multipliers is not None
        np.testing.assert_allclose(answer.multipliers[0], case.bound_multipliers, atol=2e-4)
        np.testing.assert_allclose(answer.multipliers[1], case.row_multipliers, atol=2e-4)


@needs_package
@pytest.mark.parametrize("number", [12, 43, 76, 100])
def test_answer_equals_that_of_casadis_interface(number: int) -> None:
    case = published(number)
    ours, theirs = (
        make_solver(name).solve(case.nlp, case.instance)[0] for name in ("unopy", "uno")
    )
    np.testing.assert_allclose(ours.x, theirs.x, rtol=1e-6, atol=1e-6)


@needs_package
def test_row_without_bounds_is_no_output(capfd: pytest.CaptureFixture[str]) -> None:
    case = published(71)
    free = replace(case.instance, lbg=np.full((1, 2), -np.inf), ubg=np.full((1, 2), np.inf))
    assert Unopy().solve(case.nlp, free)[0].status is Status.SOLVED
    assert capfd.readouterr() == ("", "")


@needs_package
def test_infeasible_problem_is_reported() -> None:
    x, none, wide = ca.SX.sym("x", 2), np.zeros((1, 0)), np.full((1, 2), np.inf)
    nlp = Nlp.from_expressions("none", x, ca.SX(0, 1), x[0], ca.sumsqr(x))
    low, high = np.full((1, 1), -np.inf), np.full((1, 1), -1.0)
    (solution,) = Unopy().solve(nlp, Instances(np.ones((1, 2)), none, -wide, wide, low, high))
    assert solution.status is Status.INFEASIBLE


@needs_package
def test_options_may_be_whole_numbers() -> None:
    case = published(35)
    solver = Unopy(time_limit=5)
    assert solver.solve(case.nlp, case.instance)[0].status is Status.SOLVED
