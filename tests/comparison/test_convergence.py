"""Recorded iterates: known paths of solvers, the table of gaps, and what is not recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

import casswarm as csw
from casswarm.comparison.result import NOT_REPORTED
from casswarm.solvers import Solver
from casswarm.solvers.base import IterateLog, Iterates

X = ca.SX.sym("x", 2)
BOWL = csw.Problem.from_casadi({"x": X, "f": ca.sumsqr(X)}, "bowl", x0=[4, 2])
LINE = csw.Problem.from_casadi(
    {"x": X, "f": ca.sumsqr(X), "g": X[0] + X[1]}, "line", x0=[0, 0], lbg=2, ubg=ca.inf
)
"""The minimum is 2, at (1, 1); the initial guess is infeasible by 2."""


def iterates_of(solver: Solver, problem: csw.Problem) -> Iterates | None:
    return solver.iterates(problem.nlp, next(iter(problem.starts.values())))


def test_projected_gradient_visits_a_geometric_sequence() -> None:
    # x <- x - 0.25 * 2 x = x / 2
    iterates = iterates_of(csw.solvers.ProjectedGradient(step=0.25, max_iter=30), BOWL)
    assert iterates.numbers[:6].tolist() == [0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(iterates.x, np.outer(0.5**iterates.numbers, [4, 2]), rtol=1e-12)
    assert (np.diff(iterates.seconds) >= 0).all()


@pytest.mark.parametrize(
    "solver",
    [
        csw.solvers.Ipopt(),
        csw.solvers.Sqp(),
        csw.solvers.Slsqp(),
        csw.solvers.Minimize(minimize, {"method": "trust-constr"}),
        csw.solvers.FilterInteriorPoint(),
    ],
    ids=lambda solver: solver.name,
)
def test_iterates_lead_from_the_guess_to_the_answer(solver: Solver) -> None:
    iterates = iterates_of(solver, LINE)
    answer = solver.solve(LINE.nlp, LINE.starts["given"])[0]
    assert iterates.numbers[0] == 0
    np.testing.assert_allclose(iterates.x[0], [0, 0], atol=0.05)  # Ipopt moves it off bounds
    np.testing.assert_allclose(iterates.x[-1], [1, 1], atol=1e-4)
    np.testing.assert_allclose(iterates.x[-1], answer.x, atol=1e-6)


@pytest.mark.parametrize("solver", [csw.solvers.Sqp(), csw.solvers.FilterInteriorPoint()])
def test_iterates_are_in_the_problems_own_units(solver: Solver) -> None:
    scaled = replace(LINE.starts["given"], scale=np.array([[10.0, 5.0]]))
    iterates = solver.iterates(LINE.nlp, scaled)
    np.testing.assert_allclose(iterates.x[-1], [1, 1], atol=1e-6)


def test_interior_point_has_an_iterate_for_each_iteration() -> None:
    solver = csw.solvers.FilterInteriorPoint()
    (answer,) = solver.run(LINE.nlp, LINE.starts["given"])
    assert iterates_of(solver, LINE).numbers.tolist() == list(range(answer.iterations + 1))


def test_log_keeps_the_first_some_and_the_last() -> None:
    log = IterateLog()
    for number in range(10_001):
        log([number])
    iterates = log.iterates(np.empty(0))
    assert iterates.numbers[:50].tolist() == list(range(50))
    assert iterates.numbers[-1] == iterates.x[-1] == 10_000
    assert (np.diff(iterates.numbers) > 0).all()
    assert len(iterates.numbers) < 250
    started = log.iterates(np.array([-1.0]))
    assert started.numbers[:3].tolist() == [0, 1, 2]
    assert started.x[:3, 0].tolist() == [-1, 0, 1]


@dataclass(frozen=True)
class Raising(csw.solvers.Ipopt):
    """Fails while it records."""

    name = "raising"

    def iterates(self, *_):
        """Raise."""
        raise ZeroDivisionError


@pytest.fixture(scope="module")
def comparison() -> csw.Comparison:
    solvers = ["ipopt", "slsqp", "alpaqa", Raising()]
    return csw.compare([BOWL, LINE], solvers, copies=1, time_limit=60)


def test_convergence_states_objective_violation_and_gap(comparison: csw.Comparison) -> None:
    history = comparison.convergence("line")
    assert history.best_objective == pytest.approx(2.0, abs=1e-6)
    assert history.missing == dict.fromkeys(["alpaqa", "raising"], NOT_REPORTED)
    first = history.iterates[history.iterates["solver"] == "slsqp"].iloc[0]
    assert (first["iteration"], first["objective"], first["violation"]) == (0, 0.0, 2.0)
    assert not first["feasible"]
    assert first["gap"] == pytest.approx(1.0, abs=1e-6)  # |0 - 2| / 2
    last = history.iterates.groupby("solver").last()
    assert last["feasible"].all()
    assert (last["gap"] < 1e-6).all()
    times = comparison.runs.set_index(["problem", "copy", "solver"])["solve_seconds"]
    for solver, seconds in last["seconds"].items():
        assert seconds == pytest.approx(times["line", 0, solver])


def test_iterates_are_of_originals_and_survive_a_failing_recorder(comparison) -> None:
    assert len(comparison.runs) == 2 * 2 * 4
    assert comparison.runs.loc[comparison.runs["solver"] == "raising", "solved"].all()
    assert set(comparison.iterates["solver"]) == {"ipopt", "slsqp"}
    assert not comparison.iterates.duplicated(["problem", "start", "solver", "iteration"]).any()


def test_convergence_rejects_unknown_names(comparison: csw.Comparison) -> None:
    with pytest.raises(csw.ComparisonError, match="problem 'lines' is unknown"):
        comparison.convergence("lines")
    with pytest.raises(csw.ComparisonError, match="start 'cold' is unknown"):
        comparison.convergence("line", "cold")


def test_convergence_is_drawn_with_hollow_infeasible_iterates(comparison) -> None:
    history = comparison.convergence("line")
    fig = history.plot()
    faces = {line.get_color() for line in fig.axes[0].lines if line.get_marker() != "None"}
    assert "white" in faces
    assert "without iterates: alpaqa, raising" in fig.legends[0].get_title().get_text()
    assert "line, given initial guess" in history._repr_html_()


@pytest.mark.slow
def test_divergence_is_drawn(tmp_path) -> None:
    step = csw.solvers.ProjectedGradient(step=2.0)  # x <- -3 x, until it is not finite
    comparison = csw.compare(BOWL, ["ipopt", step], time_limit=60)
    gaps = comparison.convergence().iterates["gap"]
    assert not np.isfinite(gaps).all()
    comparison.convergence().plot().savefig(tmp_path / "diverged.png")


def test_iterates_can_be_left_out() -> None:
    comparison = csw.compare(BOWL, "ipopt", record_iterates=False, time_limit=60)
    assert comparison.iterates.empty
    assert comparison.convergence().missing == {"ipopt": NOT_REPORTED}
