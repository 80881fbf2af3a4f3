"""What all solvers have in common: one verb, answers that are judged, names, pickles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from hock_schittkowski import published
from known_problems import active_box, nearest_in_box

from casswarm.errors import SolverError
from casswarm.formation import ProjectedGradient
from casswarm.nlp import Instances, Nlp, Solution, Status
from casswarm.solvers import SOLVERS, Answer, Ipopt, Solver, make_solver
from casswarm.solvers.base import VIOLATION

NAMES = ", ".join(SOLVERS)

both = pytest.mark.parametrize("solver", [Ipopt(), ProjectedGradient()], ids=lambda s: s.name)


# --- every solver


@both
def test_solver_finds_corner_of_box(solver: Solver) -> None:
    case = active_box()
    solution = solver.solve(case.nlp, case.instance)[0]
    assert solution.status is Status.SOLVED
    assert solution.solver == solver.name
    np.testing.assert_allclose(solution.x, case.x, atol=1e-6)
    assert solution.objective == pytest.approx(case.objective)
    assert solution.residuals.violation == 0
    assert solution.residuals.stationarity < 1e-5
    assert solution.residuals.complementarity < 1e-6
    assert solution.iterations > 0
    assert solution.evaluations > 0
    assert solution.solve_seconds > 0


@both
def test_solve_keeps_order_of_instances(solver: Solver) -> None:
    goals = np.random.default_rng(0).uniform(-3, 3, (300, 2))
    solutions = solver.solve(*nearest_in_box(goals))
    assert len(solutions) == 300
    nearest = np.stack([solution.x for solution in solutions])
    np.testing.assert_allclose(nearest, np.clip(goals, -1, 1), atol=1e-6)
    assert all(solution.status.success for solution in solutions)
    distances = [((goal - np.clip(goal, -1, 1)) ** 2).sum() for goal in goals]
    np.testing.assert_allclose([s.objective for s in solutions], distances, atol=1e-6)


@both
def test_solve_batch_equals_solve(solver: Solver) -> None:
    problem = nearest_in_box(np.array([[0.5, 3.0], [-2.0, 0.1], [np.nan, 0.0]]))
    batch, one_by_one = solver.solve_batch(*problem), solver.solve(*problem)
    for i, solution in enumerate(one_by_one):
        np.testing.assert_array_equal(batch.x[i], solution.x)
        np.testing.assert_array_equal(batch.objective[i], solution.objective)
        assert batch.success[i] == solution.status.success
        assert batch.violation[i] == solution.residuals.violation
        assert batch.stationarity[i] == solution.residuals.stationarity
    assert batch.success.tolist() == [True, True, False]


@both
def test_solve_empty_batch_returns_nothing(solver: Solver) -> None:
    assert solver.solve(*nearest_in_box(np.empty((0, 2)))) == []


@both
def test_solve_does_not_modify_instances(solver: Solver) -> None:
    case = active_box()
    names = ("x0", "lbx", "ubx")
    before = [getattr(case.instance, name).copy() for name in names]
    solver.solve(case.nlp, case.instance)
    for name, array in zip(names, before, strict=True):
        np.testing.assert_array_equal(getattr(case.instance, name), array)


def test_status_success_is_solved_or_acceptable() -> None:
    assert [status for status in Status if status.success] == [Status.SOLVED, Status.ACCEPTABLE]


# --- verification of reported statuses


@dataclass(frozen=True)
class FixedAnswer(Solver):
    """Solver that reports the same x and status for every instance."""

    x: tuple[float, ...]
    status: Status = Status.SOLVED
    answers: int | None = None

    name: ClassVar[str] = "fixed"
    summary: ClassVar[str] = "reports a fixed answer"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:  # noqa: ARG002
        count = len(instances) if self.answers is None else self.answers
        return [Answer(np.array(self.x), self.status, "trust me", 3, 4, 0.5)] * count


def reported(*x: float, status: Status = Status.SOLVED) -> Solution:
    case = published(35)
    return FixedAnswer(x, status).solve(case.nlp, case.instance)[0]


def test_solve_keeps_verified_status() -> None:
    solution = reported(4 / 3, 7 / 9, 4 / 9)
    assert solution.status is Status.SOLVED
    assert solution.objective == pytest.approx(1 / 9)
    assert solution.residuals.stationarity < 1e-6
    numbers = (solution.iterations, solution.evaluations, solution.solve_seconds)
    assert numbers == (3, 4, 0.5)


@pytest.mark.parametrize("status", [Status.SOLVED, Status.ACCEPTABLE])
@pytest.mark.parametrize(
    ("x", "worst"),
    [
        ((1, 1, 1), "budget[0]"),
        ((1, -0.1, 0), "bound[1]"),
        ((1, 1, 0.5 + VIOLATION), "budget[0]"),
        ((np.nan, 0, 0), "not finite"),
        ((0, np.inf, 0), "not finite"),
    ],
)
def test_solve_unverified_success_is_failed(
    x: tuple[float, ...], worst: str, status: Status
) -> None:
    solution = reported(*x, status=status)
    assert solution.status is Status.FAILED
    assert solution.message == "trust me"
    assert solution.residuals.violated_row == worst
    assert solution.residuals.violation > VIOLATION


def test_solve_tolerates_small_violation() -> None:
    assert reported(1, 1, 0.5 + VIOLATION / 4).status is Status.SOLVED


@pytest.mark.parametrize("status", [status for status in Status if not status.success])
def test_solve_never_turns_failure_into_success(status: Status) -> None:
    assert reported(4 / 3, 7 / 9, 4 / 9, status=status).status is status
    assert reported(9, 9, 9, status=status).status is status


def test_solve_missing_answer_raises() -> None:
    with pytest.raises(SolverError, match="fixed gave 1 answers for 3"):
        FixedAnswer((0.0, 0.0), answers=1).solve(*nearest_in_box(np.zeros((3, 2))))


# --- solutions


def test_solution_str_states_status_and_residuals() -> None:
    text = str(reported(1, 1, 1))
    assert text.startswith("failed by fixed (trust me): objective 0, violation 1.0e+00,")
    assert text.endswith("3 iterations, 500.0 ms")


def test_solution_as_row_contains_plain_values() -> None:
    row = reported(1, 1, 1).as_row()
    assert "x" not in row
    assert row["status"] == "failed"
    assert type(row["status"]) is str
    assert (row["violation"], row["violated_row"], row["message"]) == (1, "budget[0]", "trust me")
    assert {type(value) for value in row.values()} <= {str, int, float}


# --- names and options


def test_solvers_are_registered_by_name() -> None:
    assert {"ipopt", "projected-gradient"} <= set(SOLVERS)
    for name, kind in SOLVERS.items():
        assert kind.name == name
        assert kind.summary
        if not kind.unavailable():
            assert make_solver(name) == kind()


def test_make_solver_accepts_name_or_solver() -> None:
    assert make_solver("ipopt", max_iter=7) == Ipopt(max_iter=7) != Ipopt()
    assert ProjectedGradient(tolerance=1e-7) != ProjectedGradient()
    own = FixedAnswer((0.0,))
    assert make_solver(own) is own


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("ipop", {}, f"solver 'ipop' is unknown; did you mean 'ipopt'? (known: {NAMES})"),
        ("simplex", {}, f"solver 'simplex' is unknown (known: {NAMES})"),
        (
            "ipopt",
            {"tolerence": 1e-9},
            "solver 'ipopt' has no option 'tolerence'; did you mean 'tolerance'? "
            "(known: tolerance, max_iter, time_limit, hessian, memory, "
            "mu_strategy, constraint_tolerance, bound_push, mu_init, print_level)",
        ),
        (
            "projected-gradient",
            {"zeal": 1},
            "solver 'projected-gradient' has no option 'zeal' "
            "(known: step, x_scale, max_iter, tolerance, keep, start)",
        ),
        ("ipopt", {"tolerance": 0.0}, "ipopt: tolerance = 0.0; allowed: above zero"),
        ("ipopt", {"tolerance": np.nan}, "ipopt: tolerance = nan; allowed: above zero"),
        ("ipopt", {"max_iter": -1}, "ipopt: max_iter = -1; allowed: zero or above"),
        ("ipopt", {"time_limit": 0}, "ipopt: time_limit = 0; allowed: above zero"),
        (
            "ipopt",
            {"hessian": "bfgs"},
            "ipopt: hessian = 'bfgs'; allowed: 'exact' or 'limited-memory'",
        ),
        ("projected-gradient", {"step": 0}, "step = 0; allowed: above zero, finite"),
        ("projected-gradient", {"max_iter": -1}, "max_iter = -1; allowed: zero or above"),
        ("projected-gradient", {"tolerance": -1}, "tolerance = -1; allowed: zero or above"),
        ("projected-gradient", {"keep": "first"}, "keep = 'first'; allowed: 'last' or 'best'"),
        ("projected-gradient", {"start": "one"}, "start = 'one'; allowed: 'x0' or 'zero'"),
    ],
)
def test_make_solver_rejects_wrong_names_and_options(
    name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(SolverError) as caught:
        make_solver(name, **options)
    assert message in str(caught.value)
