"""Fault tolerance: solvers that return NaN or false successes, raise, hang or crash."""

from __future__ import annotations

import logging
import pickle
import threading
from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest
from commands import python
from faulty_solvers import FAULTS, Counting, Faulty
from known_problems import active_box, nearest_in_box
from small_scenarios import small

import casswarm as csw
from casswarm.comparison import Problem
from casswarm.errors import CheckpointError, SolverError
from casswarm.nlp import Status
from casswarm.policies import formation_policies as formation
from casswarm.solvers import Ipopt, Isolated, NlpSol, isolated

PAPER = csw.load_scenario("paper-1")
DEADLY = ("hang", "exit", "abort", "kill")
MESSAGES = {
    "hang": "no answer within",
    "exit": "exit code 3",
    "abort": "(SIGABRT); the last line that it printed: something terrible",
    "kill": "exit code -9 (SIGKILL)",
    "raise": "raised ZeroDivisionError: not today",
    "build": "building raised RuntimeError: cannot be built",
    "wrong shape": "gave x of shape (1,)",
    "nothing": "raised TypeError",
    "nan": "fine",
    "infeasible success": "fine",
}


def goals(*points):
    """Instances whose first parameter is the first coordinate of a goal."""
    return nearest_in_box(np.array(points, float))


# --- one instance costs no other


@pytest.mark.parametrize("fault", [f for f in MESSAGES if f not in DEADLY])
def test_faulty_instance_leaves_others_solved(fault):
    solver = Faulty(fault, above=-np.inf if fault == "build" else 2.0)
    fine, bad, other = solver.solve(*goals((0.5, 3.0), (2.5, 0.0), (-2.0, 0.1)))
    assert bad.status is Status.FAILED
    assert MESSAGES[fault] in bad.message
    if fault == "build":
        assert fine.status is other.status is Status.FAILED
    else:
        assert fine.status is other.status is Status.SOLVED
        np.testing.assert_allclose([fine.x, other.x], [[0.5, 1], [-1, 0.1]], atol=1e-6)


def test_solve_interrupt_inside_casadi_propagates():
    class Interrupted(Faulty):
        def _misbehave(self):
            raise RuntimeError("Error in Function::call: KeyboardInterrupt")

    with pytest.raises(KeyboardInterrupt):
        Interrupted().solve(*goals((0.0, 0.0)))


# --- a process of its own


@pytest.mark.slow
@pytest.mark.parametrize("fault", DEADLY)
def test_isolated_replaces_process_after_crash_or_hang(fault):
    solver = Isolated(Faulty(fault, above=2.0), time_limit=2.0)
    fine, bad, other = solver.solve(*goals((0.5, 3.0), (2.5, 0.0), (-2.0, 0.1)))
    assert bad.status is (Status.TIME_LIMIT if fault == "hang" else Status.FAILED)
    assert MESSAGES[fault] in bad.message
    assert fine.status is other.status is Status.SOLVED
    np.testing.assert_allclose([fine.x, other.x], [[0.5, 1], [-1, 0.1]], atol=1e-6)
    solver.close()


def test_isolated_answers_equal_those_of_solver():
    problem = goals((0.5, 3.0), (-2.0, 0.1), (0.3, 0.2))
    isolated = Isolated(Ipopt(), time_limit=30.0)
    for a, b in zip(isolated.solve(*problem), Ipopt().solve(*problem), strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        assert (a.solver, a.status, a.residuals, a.iterations) == (
            ("ipopt", b.status, b.residuals, b.iterations)
        )
    batch = isolated.solve_batch(*problem)
    assert batch.success.all()
    assert all(batch.messages)
    assert isolated.solve(*goals((0.0, 0.0)))[0].build_seconds > 0
    isolated.close()
    assert pickle.loads(pickle.dumps(isolated)) == isolated


@pytest.mark.slow
def test_isolated_stops_after_repeated_crashes():
    solver = Isolated(Faulty("exit"), time_limit=20.0)
    solutions = solver.solve(*goals(*np.zeros((6, 2))))
    assert [s.status for s in solutions] == [Status.FAILED] * 6
    assert [s.message.startswith("not tried") for s in solutions] == [False] * 3 + [True] * 3


def test_isolated_answer_that_does_not_pickle_is_failed():
    solver = Isolated(Faulty("unsendable", above=2.0))
    (bad,) = solver.solve(*goals((2.5, 0.0)))
    assert bad.status is Status.FAILED
    assert "answer cannot be sent: " in bad.message
    (fine,) = solver.solve(*goals((0.5, 3.0)))  # by the same process
    assert fine.status is Status.SOLVED
    solver.close()


def test_isolated_rejects_what_does_not_pickle():
    holding = Faulty()
    object.__setattr__(holding, "lock", threading.Lock())
    with pytest.raises(SolverError, match="it holds something that does not pickle"):
        Isolated(holding).solve(*goals((0.0, 0.0)))
    with pytest.raises(SolverError, match="allowed: a Solver"):
        Isolated("ipopt")
    with pytest.raises(SolverError, match="time_limit = 0; allowed: above zero"):
        Isolated(Ipopt(), 0)


def test_isolated_error_has_the_values_of_the_solver_inside():
    solver = Isolated(NlpSol("nosuch"))
    with pytest.raises(SolverError, match="nosuch cannot run here") as caught:
        solver.solve(*goals((0.0, 0.0)))
    assert caught.value.solver == "nosuch"
    solver.close()


def test_isolated_in_script_without_main_guard_raises(tmp_path):
    (tmp_path / "study.py").write_text(
        "from casswarm.solvers import Ipopt, Isolated\nIsolated(Ipopt()).start()\n"
    )
    done = python("study.py", folder=tmp_path, code=None)
    assert done.returncode == 1
    assert "if __name__ == '__main__':" in done.stderr.splitlines()[-1]


# --- in a comparison


def problems(count=2):
    """Small problems, the nearest points of a box."""
    made = []
    for number in range(count):
        nlp, instances = goals((0.5 + 2 * number, 3.0))
        made.append(Problem(f"goal-{number}", "goals", nlp, {"cold": instances}))
    return made


@pytest.fixture(scope="module")
def study():
    solvers = {fault: Faulty(fault, above=2.0) for fault in FAULTS if fault != "build"}
    solvers |= {"build": Faulty("build"), "ipopt": Ipopt()}
    return csw.compare(problems(), solvers, time_limit=2.0)


@pytest.mark.slow
def test_compare_reports_every_fault_with_reason(study):
    runs = study.runs.set_index(["solver", "problem"])
    assert len(runs) == 2 * (len(FAULTS) + 1)
    for fault in FAULTS:
        bad = runs.loc[fault, "goal-1"]
        assert not bad["solved"]
        assert bad["status"] == ("time limit" if fault == "hang" else bad["status"])
        assert MESSAGES.get(fault, "") in bad["message"]
        assert bad["reason"]
        assert runs.loc[fault, "goal-0"]["solved"] == (fault != "build")
    assert runs.loc["ipopt"]["solved"].all()


@pytest.mark.slow
def test_compare_counts_false_positives(study):
    runs = study.runs[study.runs["problem"] == "goal-1"].set_index("solver")
    for fault in ("nan", "infeasible success", "non-stationary success"):
        assert runs.loc[fault, "reported_success"]
        assert not runs.loc[fault, "verified"]
        assert runs.loc[fault, "reason"].startswith("reported as solved, but ")
    assert "stationarity" in runs.loc["non-stationary success", "reason"]
    assert "violation" in runs.loc["infeasible success", "reason"]
    counts = study.summary.set_index("solver")
    assert counts.loc["non-stationary success", "false_positives"] == 1
    assert counts.loc["non-stationary success", "solved"] == 0.5
    assert counts.loc["hang", "unsolved"] == 1


# --- in a simulation


@pytest.fixture(scope="module")
def guide():
    return csw.plan(PAPER)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("nan", "failed: fine"),
        ("infeasible success", "failed: fine"),
        ("non-stationary success", "solved: fine, but not stationary"),
        ("raise", "raised ZeroDivisionError: not today"),
    ],
)
def test_simulate_counts_and_logs_solver_failures(fault, reason, guide, caplog):
    formation._log_once.cache_clear()
    with caplog.at_level(logging.WARNING, "casswarm"):
        study = csw.simulate(PAPER, ["constrained"], 10, guide=guide, solver=Faulty(fault))
    assert (study.runs["solver_failures"] > 0).all()
    assert study.summary["solver_failures"][0] == study.runs["solver_failures"].sum()
    assert reason in caplog.text
    assert len(caplog.records) == len({record.getMessage() for record in caplog.records})


def test_simulate_counts_only_failed_states(guide):
    # the first parameter is where member 0 is: it goes wrong on the way, not at the start
    study = csw.simulate(PAPER, ["constrained"], 10, guide=guide, solver=Faulty("raise", above=3.0))
    late = study.runs["steps"].max()
    assert 0 < study.runs["solver_failures"].max() < late


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "runs", "reason"),
    [
        ("exit", 3, "its process ended with exit code 3"),
        ("kill", 3, "its process ended with exit code -9 (SIGKILL)"),
        ("hang", 1, "time limit: no answer within 4 s, so its process was ended"),
    ],
)
def test_simulate_survives_crashing_solver(fault, runs, reason, caplog):
    formation._log_once.cache_clear()
    scenario = small([(0.0, 0.0), (0.3, 0.0)], (1.5, 0.0), [(0.7, 1.5)], 3, hazard__alpha_1=0.1)
    # once member 0 is on its way
    deadly = Isolated(Faulty(fault, above=0.5), time_limit=4.0 if fault == "hang" else 20.0)
    with caplog.at_level(logging.WARNING, "casswarm"):
        study = csw.simulate(scenario, ["leader"], runs, solver=deadly)
    deadly.close()
    assert study.runs["survivors"].tolist() == [2] * runs
    assert (study.runs["solver_failures"] > 0).all()
    assert (study.runs["solver_failures"] < study.runs["steps"]).all()
    assert study.summary["solver_failures"][0] == study.runs["solver_failures"].sum()
    assert reason in caplog.text


# --- checkpoints of a comparison


def test_compare_resumes_where_it_stopped(tmp_path):
    options = {"checkpoint": tmp_path, "if_exists": "resume", "time_limit": 20.0}
    first = csw.compare(problems(), ["ipopt"], **options)
    (record, _) = sorted(tmp_path.rglob("*.npz"))
    record.write_bytes(record.read_bytes()[:20])  # damaged
    reports = []
    again = csw.compare(
        problems(), ["ipopt"], progress=lambda *report: reports.append(report), **options
    )
    assert reports == [("comparing", done, 2) for done in (0, 1, 2)]
    same = ["problem", "objective", "status"]
    assert first.runs[same].equals(again.runs[same])
    assert first.runs["solve_seconds"][1] == again.runs["solve_seconds"][1]
    assert first.runs["solve_seconds"][0] != again.runs["solve_seconds"][0]
    assert len(list(tmp_path.rglob("*.npz"))) == 2


@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        ({"seed": 3}, "seed: 0 there, 3 now"),
        ({"time_limit": 5.0}, "time_limit: 10.0 there, 5.0 now"),
        ({"solvers": [Ipopt(tolerance=1e-4)]}, "Ipopt(tolerance=0.0001"),
        ({"solvers": {"ipopt": Ipopt(), "other": Ipopt()}}, "solvers.other: nothing there"),
        ({"problems": problems(1)}, "problems.goal-1: "),
    ],
)
def test_compare_rejects_checkpoint_of_other_inputs(tmp_path, changed, difference):
    usual = {"problems": problems(), "solvers": ["ipopt"], "seed": 0, "time_limit": 10.0}
    csw.compare(**usual, checkpoint=tmp_path)
    with pytest.raises(CheckpointError) as caught:
        csw.compare(**usual | changed, checkpoint=tmp_path, if_exists="resume")
    assert difference in str(caught.value)
    assert "choose another folder" in str(caught.value)


# --- warm-up of processes


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


@pytest.mark.slow
def test_compare_warms_up_a_solver_after_it_ended_its_process() -> None:
    runs = csw.compare(
        _problems("fine", "deadly", "other"), Counting(), time_limit=30, record_iterates=False
    ).runs.set_index("problem")
    assert runs.loc["deadly", "message"].startswith("its process ended with exit code 3")
    assert runs.loc["fine", "message"] == runs.loc["other", "message"] == "1 before"
