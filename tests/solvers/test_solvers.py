"""All solvers: one verb, judged answers, names, options, iterations, time, Ctrl-C."""

from __future__ import annotations

import pickle
import signal
import sys
from collections.abc import Sequence
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from available_solvers import GENERAL, each
from backend_cases import Case, formation, guide
from commands import python
from hock_schittkowski import published
from known_problems import active_box, instances, nearest_in_box

from casswarm.errors import SolverError
from casswarm.formation import ProjectedGradient
from casswarm.nlp import Instances, Nlp, Residuals, Solution, Status
from casswarm.solvers import SOLVERS, Answer, Ipopt, Solver, make_solver
from casswarm.solvers.base import VIOLATION, failed

NAMES = ", ".join(SOLVERS)

both = pytest.mark.parametrize("solver", [Ipopt(), ProjectedGradient()], ids=lambda s: s.name)


# --- every solver


@both
def test_solver_finds_corner_of_box(solver: Solver) -> None:
    case = active_box()
    names = ("x0", "lbx", "ubx")
    before = [getattr(case.instance, name).copy() for name in names]
    solution = solver.solve(case.nlp, case.instance)[0]
    for name, array in zip(names, before, strict=True):  # the instance is as before
        np.testing.assert_array_equal(getattr(case.instance, name), array)
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
    assert solver.solve(*nearest_in_box(np.empty((0, 2)))) == []


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
    assert reported(1, 1, 0.5 + VIOLATION / 4).status is Status.SOLVED
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


@pytest.mark.parametrize("status", [status for status in Status if not status.success])
def test_solve_never_turns_failure_into_success(status: Status) -> None:
    assert reported(4 / 3, 7 / 9, 4 / 9, status=status).status is status
    assert reported(9, 9, 9, status=status).status is status


def test_solve_missing_answer_raises() -> None:
    with pytest.raises(SolverError, match="fixed gave 1 answers for 3"):
        FixedAnswer((0.0, 0.0), answers=1).solve(*nearest_in_box(np.zeros((3, 2))))


# --- solutions


def test_solution_is_stated_as_text_and_as_row_of_plain_values() -> None:
    solution = reported(1, 1, 1)
    assert str(solution).startswith("failed by fixed (trust me): objective 0, violation 1.0e+00,")
    assert str(solution).endswith("3 iterations, 500.0 ms")
    row = solution.as_row()
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


# --- every backend at its limits


EVERY = list(SOLVERS)
TIMED = [name for name in EVERY if SOLVERS[name].capabilities.time_limit]
LIMITS: dict[str, dict[str, Any]] = {
    "alpaqa": {"max_iter": 2, "max_inner_iter": 2},
}
"""Options that stop a backend early; max_iter for the others."""


def hard(name: str) -> Case:
    return guide(4.62) if name in GENERAL else formation("constrained, collisions")


@pytest.mark.parametrize("name", each(EVERY))
def test_options_are_frozen_and_unknown_ones_rejected(name: str) -> None:
    solver = make_solver(name)
    assert is_dataclass(solver)
    first = fields(solver)[0].name
    with pytest.raises(FrozenInstanceError):
        setattr(solver, first, getattr(solver, first))
    with pytest.raises(SolverError) as caught:
        make_solver(name, **{f"{first}x": 1})
    message = str(caught.value)
    assert message.startswith(f"solver {name!r} has no option '{first}x'; did you mean {first!r}?")
    assert all(option.name in message for option in fields(solver))
    assert pickle.loads(pickle.dumps(solver)) == solver
    assert hash(solver) == hash(make_solver(name))


@pytest.mark.parametrize("name", each(n for n in EVERY if n != "auto"))
def test_options_out_of_range_are_rejected(name: str) -> None:
    solver = make_solver(name)
    numbers = [
        f.name for f in fields(SOLVERS[name]) if isinstance(getattr(solver, f.name), int | float)
    ]
    assert numbers
    for option in numbers:
        with pytest.raises(SolverError, match=f"{name}: {option} = -1; allowed: "):
            make_solver(name, **{option: -1})


@pytest.mark.parametrize("name", each(n for n in EVERY if n != "spectral"))  # which wants sets
def test_solver_nan_parameter_is_not_success(name: str) -> None:
    """The objective of the second instance is NaN everywhere; the others do not suffer."""
    x, q = ca.MX.sym("x", 2), ca.MX.sym("q")
    nlp = Nlp("root", {"x": x}, {"q": q}, ca.sumsqr(x - ca.sqrt(q)), {})
    batch = instances(np.ones((3, 2)), [[4.0], [-1.0], [9.0]], lbx=-10, ubx=10)
    good, bad, other = make_solver(name).solve(nlp, batch)
    assert (good.status, other.status) == (Status.SOLVED, Status.SOLVED)
    np.testing.assert_allclose([good.x, other.x], [[2, 2], [3, 3]], atol=1e-5)
    assert not bad.status.success
    if name in ("ipopt", "projected-gradient"):
        assert bad.status is Status.FAILED
        assert np.isnan(bad.objective)
    assert bad.residuals == Residuals(np.inf, np.inf, np.inf, "not finite")


@pytest.mark.parametrize("name", each(n for n in EVERY if n != "auto"))
def test_solver_iteration_limit_is_reported(name: str) -> None:
    solution = make_solver(name, **LIMITS.get(name, {"max_iter": 2})).solve(*hard(name))[0]
    assert solution.status is Status.ITERATION_LIMIT, solution
    assert not solution.status.success
    assert solution.message
    assert np.isfinite(solution.residuals.stationarity)


@pytest.mark.parametrize("name", ["ipopt", "projected-gradient"])
def test_single_iteration_is_counted(name: str) -> None:
    case = active_box()
    solution = make_solver(name, max_iter=1).solve(case.nlp, case.instance)[0]
    assert (solution.status, solution.iterations) == (Status.ITERATION_LIMIT, 1)


@pytest.mark.parametrize("name", each(TIMED))
def test_solver_time_limit_is_reported(name: str) -> None:
    solution = make_solver(name, time_limit=1e-3).solve(*guide(10.0))[0]
    assert solution.status is Status.TIME_LIMIT, solution
    assert solution.message
    assert solution.x.shape == guide(10.0)[1].x0.shape[1:]


def test_solvers_without_time_limit_have_no_option() -> None:
    assert set(GENERAL) - set(TIMED) == {"auto", "sqp"}


@pytest.mark.parametrize("apart", [0.0, 1.0])
@pytest.mark.parametrize("name", each([*GENERAL, "projected-gradient"]))
def test_all_solvers_reject_crossing_bounds(name: str, apart: float) -> None:
    case = active_box()
    bounds = {"lbx": case.instance.ubx + apart, "ubx": case.instance.lbx}
    solution = make_solver(name).solve(case.nlp, replace(case.instance, **bounds))[0]
    assert not solution.status.success
    assert solution.message
    if name in ("ipopt", "projected-gradient"):
        assert solution.status is Status.FAILED
        assert solution.residuals.violation > 0


INTERRUPTED = """
import os, signal, sys, threading, time
sys.path.insert(0, {tests!r})
from available_solvers import GENERAL, each
from backend_cases import guide
from casswarm.solvers import make_solver

for name in {names!r}:
    solver, case = make_solver(name), guide(10.0)
    solver.prepare(case[0])
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    end = time.monotonic() + 30
    timer.start()
    try:
        while time.monotonic() < end:
            solver.solve(*case)
        print(name, "swallowed it")
    except KeyboardInterrupt:
        print(name, "stopped")
"""


@pytest.mark.slow
def test_ctrl_c_stops_every_solver() -> None:
    names = [name for name in GENERAL if not SOLVERS[name].unavailable()]
    script = INTERRUPTED.format(tests=str(Path(__file__).parents[1] / "helpers"), names=names)
    done = python("-c", script, timeout=240)
    assert done.stdout.splitlines() == [f"{name} stopped" for name in names]


@dataclass(frozen=True)
class Suppressing(Solver):
    """A solver whose code loses an interrupt, as compiled conversions of arguments may."""

    raised: type[Exception] | None

    name: ClassVar[str] = "suppressing"
    summary: ClassVar[str] = "suppresses Ctrl-C"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:  # noqa: ARG002
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if self.raised is not None:
                raise self.raised("masks the interrupt") from None
        return failed(instances, "no interrupt reached the caller")


@pytest.mark.parametrize("raised", [None, TypeError])
def test_suppressed_ctrl_c_stops_solve(raised: type[Exception] | None) -> None:
    nlp, instance = active_box().nlp, active_box().instance
    with pytest.raises(KeyboardInterrupt):
        Suppressing(raised).solve(nlp, instance)


@pytest.mark.parametrize(("call", "words"), [("prepare", "building raised"), ("run", "raised")])
def test_exit_in_solver_is_failed_solution(
    call: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Code that ends the interpreter, when it builds a problem or when it solves one."""
    monkeypatch.setattr(FixedAnswer, call, lambda *_: sys.exit(0))
    solution = FixedAnswer((0.0, 0.0)).solve(active_box().nlp, active_box().instance)[0]
    assert solution.status is Status.FAILED
    assert solution.message.startswith(f"{words} SystemExit")
