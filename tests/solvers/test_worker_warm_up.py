"""Warm-up of a solver's process and of those that replace it."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import pytest
from faulty_solvers import Counting
from known_problems import active_box

import casswarm as csw
from casswarm.comparison import Problem
from casswarm.solvers import Isolated, isolated


def _problems(*names: str) -> list[Problem]:
    x = ca.SX.sym("x", 2)
    return [Problem.from_casadi({"x": x, "f": ca.sumsqr(x - 1)}, name) for name in names]


@pytest.fixture
def warm() -> Iterator[Isolated]:
    """Solver whose processes solve a small problem first."""
    solver = Isolated(Counting())
    case = active_box()
    solver.warm_up(case.nlp, case.instance)
    yield solver
    solver.close()


def _message(solver: Isolated, problem: Problem) -> str:
    (answer,) = solver.run(problem.nlp, problem.starts["given"])
    return str(answer.message)


def test_process_that_replaces_another_is_warmed_up(warm: Isolated) -> None:
    fine, deadly, other = _problems("fine", "deadly", "other")
    assert _message(warm, fine) == "1 before"
    assert "exit code 3" in _message(warm, deadly)
    assert _message(warm, other) == "1 before"


def test_process_replaced_for_its_number_of_programs_is_warmed_up(
    warm: Isolated, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolated, "_MAX_PROGRAMS", 3)
    messages = [_message(warm, problem) for problem in _problems("a", "b", "c")]
    assert messages == ["1 before", "2 before", "1 before"]


def test_process_after_close_is_not_warmed_up(warm: Isolated) -> None:
    (fine,) = _problems("fine")
    warm.start()
    warm.close()
    assert _message(warm, fine) == "0 before"


def test_warm_up_that_ends_the_process_is_given_up() -> None:
    fine, deadly = _problems("fine", "deadly")
    solver = Isolated(Counting())
    solver.warm_up(deadly.nlp, deadly.starts["given"])
    assert _message(solver, fine) == "0 before"
    solver.close()


def test_compare_warms_up_a_solver_after_it_ended_its_process() -> None:
    runs = csw.compare(
        _problems("fine", "deadly", "other"), Counting(), time_limit=30, record_iterates=False
    ).runs.set_index("problem")
    assert runs.loc["deadly", "message"].startswith("its process ended with exit code 3")
    assert runs.loc["fine", "message"] == runs.loc["other", "message"] == "1 before"
