"""Comparison of solvers: benchmark problems, verification, figures and report."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from faulty_solvers import SlowAtFirst
from hock_schittkowski import published
from known_problems import active_box, nearest_in_box
from solver_runs import run

import casswarm as csw
from casswarm.comparison import (
    Problem,
    Tolerances,
    costs,
    make_problems,
    make_report,
    summary,
    verify,
)
from casswarm.comparison.verification import by_problem, failures
from casswarm.errors import ComparisonError, SolverError
from casswarm.formation import ProjectedGradient
from casswarm.solvers import Ipopt

# --- problems


@pytest.fixture(scope="module")
def quick():
    return make_problems("quick")


def test_make_problems_depends_on_seed_only(quick):
    again, other = make_problems("quick"), make_problems("quick", seed=1)
    assert [p.name for p in again] == [p.name for p in quick] == [p.name for p in other]
    assert [p.fingerprint() for p in again] == [p.fingerprint() for p in quick]
    assert not {p.fingerprint() for p in other} & {p.fingerprint() for p in quick}


def test_problem_starts_differ_only_in_x0(quick):
    for problem in quick:
        cold, warm = problem.starts["cold"], problem.starts["warm"]
        assert not np.array_equal(cold.x0, warm.x0)
        for part in ("p", "lbx", "ubx", "lbg", "ubg"):
            np.testing.assert_array_equal(getattr(cold, part), getattr(warm, part))
    assert {p.family for p in quick} == {"guides", "formations"}


def test_formation_problems_have_free_members(quick):
    for problem in quick:
        if problem.family == "formations":
            instance = problem.starts["warm"]
            assert (instance.ubx > instance.lbx).any()
            solution = Ipopt().solve(problem.nlp, instance)[0]
            assert solution.status.success


TWO, BOTH = nearest_in_box(np.zeros((2, 2)))
REFUSED = [
    (lambda _: make_problems("guidess"), "did you mean 'guides'"),
    (lambda _: make_problems("guides", 0), "count = 0; allowed"),
    (lambda _: csw.compare("quik"), "did you mean 'quick'"),
    (lambda given: csw.compare(given, []), "no solver given"),
    (
        lambda given: csw.compare([given], [Ipopt(), Ipopt(tolerance=1e-4)]),
        "solvers of the same name: ipopt; give a mapping",
    ),
    (lambda given: csw.compare([given] * 2, "ipopt"), "problems of the same name: guide-10-0"),
    (lambda _: Problem("two", "f", TWO, {"cold": BOTH}), "has 2 instances as its cold start"),
    (
        lambda given: csw.compare(given, "ipopt", copies=-1),
        "copies = -1; allowed: whole numbers from 0",
    ),
    (lambda given: csw.compare(given, "ipopt", copies=1.5), "copies = 1.5"),
    (lambda given: csw.compare(given, "ipopt", time_limit=0), "time_limit = 0"),
    (lambda _: Tolerances(objective=-1), "tolerance objective = -1"),
]


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_invalid_arguments_are_refused(quick, call, words):
    with pytest.raises(ComparisonError, match=re.escape(words)):
        call(quick[0])
    with pytest.raises(SolverError, match="did you mean 'ipopt'"):
        csw.compare([quick[0]], ["ipop"])


# --- verification, of a table written by hand


NOT_APPLICABLE = {"solve_seconds": np.nan, "violation": np.nan, "stationarity": np.nan}
LOST = {"violation": np.inf, "stationarity": np.inf}
RUNS = pd.DataFrame(
    [
        run("p", "good", objective=2.0),
        run("p", "local", objective=2.1),
        run("p", "liar", objective=1.0, violation=0.5, violated_row="budget[0]"),
        run("p", "shy", "iteration limit", objective=2.0, message="message"),
        run("p", "lost", "failed", np.nan, **LOST),
        run("p", "picky", "not applicable", np.nan, **NOT_APPLICABLE),
        run("q", "good", objective=3.0, solve_seconds=0.4),
        run("q", "local", objective=3.0, solve_seconds=0.2),
        run("q", "liar", objective=3.0, stationarity=1.0),
        run("q", "shy", objective=3.0 + 1e-5),
        run("q", "lost", "time limit", objective=2.9, stationarity=1.0),
        run("q", "picky", "not applicable", np.nan, **NOT_APPLICABLE),
    ]
)


@pytest.fixture(scope="module")
def table():
    return verify(RUNS, Tolerances()).set_index(["problem", "solver"], drop=False)


def test_verify_best_objective_is_least_of_feasible_answers(table):
    best = table["best_objective"]
    assert best["p"].tolist() == [2.0] * 6  # not the 1 of an infeasible answer
    assert best["q"].tolist() == [2.9] * 6  # one at a time limit counts if it is feasible
    assert table.loc[("p", "local"), "gap"] == pytest.approx(0.05)


def test_verify_solved_is_reported_and_verified(table):
    assert table.index[table["solved"]].tolist() == [
        ("p", "good"), ("p", "local"), ("q", "good"), ("q", "local"), ("q", "shy"),
    ]  # fmt: skip
    assert table.index[table["best_known"]].tolist() == [("p", "good")]
    assert table.loc[("p", "shy"), "verified"]
    assert not table.loc[("p", "shy"), "reported_success"]


def test_verify_reason_names_violated_tolerance(table):
    reasons = table["reason"]
    assert reasons["p", "good"] == ""
    assert reasons["p", "liar"] == "reported as solved, but violation 5.0e-01 (budget[0]) > 1e-06"
    assert reasons["q", "liar"] == "reported as solved, but stationarity 1.0e+00 > 0.0001"
    assert reasons["p", "shy"] == "iteration limit: message"


def test_summary_counts_reported_against_verified(table):
    counts = summary(table.reset_index(drop=True), time_limit=10.0).set_index("solver")
    assert "picky" not in counts.index  # applies to nothing in the family
    columns = ["true_positives", "false_positives", "missed", "unsolved"]
    found = counts.loc[["good", "liar", "shy", "lost"], columns].to_numpy().tolist()
    assert found == [[2, 0, 0, 0], [0, 2, 0, 0], [1, 0, 1, 0], [0, 0, 0, 2]]
    assert counts.loc["good", "mean_ms"] == pytest.approx(1e3 * (np.sqrt(0.101 * 0.401) - 0.001))
    assert counts.loc["lost", "mean_ms"] == pytest.approx(10_000)


def test_costs_of_failures_are_infinite(table):
    times = costs(table.reset_index(drop=True), "f", "cold", "solve_seconds")
    assert times.columns.tolist() == ["good", "local", "liar", "shy", "lost"]
    assert times.loc["p"].tolist() == [0.1, 0.1, np.inf, np.inf, np.inf]
    found = costs(table.reset_index(drop=True), "f", "cold", "solve_seconds", "best_known")
    assert np.isfinite(found).to_numpy().sum() == 1


def test_costs_of_partly_applicable_solver_are_infinite():
    runs = RUNS.copy()
    runs.loc[5] = pd.Series(run("p", "picky"))
    times = costs(verify(runs, Tolerances()), "f", "cold", "solve_seconds")
    assert times["picky"].tolist() == [0.1, np.inf]


def test_by_problem_and_failures_count_solvers(table):
    plain = table.reset_index(drop=True)
    problems = by_problem(plain).set_index("problem")
    assert problems.loc["q", ["applicable", "solved", "best_known"]].tolist() == [5, 3, 0]
    assert problems.loc["q", "fastest"] == "shy"
    assert problems.loc["p", "largest_gap"] == pytest.approx(0.05)
    failed = failures(plain)
    assert set(failed["solver"]) == {"liar", "shy", "lost"}
    assert failed["runs"].sum() == 5


# --- a comparison of known problems


@pytest.fixture(scope="module")
def known():
    cases = {"corner": active_box(), "valley": published(1), "hs-35": published(35)}
    problems = [
        Problem(name, "known", case.nlp, {"cold": case.instance}) for name, case in cases.items()
    ]
    reports = []
    comparison = csw.compare(
        problems,
        {
            "ipopt": "ipopt",
            "hasty": ProjectedGradient(tolerance=1e3),
            "gradient": ProjectedGradient(),
        },
        time_limit=20.0,  # on a busy machine
        progress=lambda *report: reports.append(report),
    )
    return comparison, reports, cases


@pytest.mark.slow
def test_what_a_process_does_once_is_not_timed():
    case = active_box()
    problem = Problem("corner", "known", case.nlp, {"cold": case.instance})
    runs = csw.compare(problem, SlowAtFirst(), time_limit=3.0).runs
    assert runs["solved"].all()
    assert (runs["solve_seconds"] < 3.0).all()


def test_compare_finds_and_verifies_known_optima(known):
    comparison, reports, cases = known
    runs = comparison.runs.set_index(["problem", "solver"])
    for name, case in cases.items():
        assert runs.loc[(name, "ipopt"), "solved"]
        assert runs.loc[(name, "ipopt"), "objective"] == pytest.approx(case.objective, abs=1e-6)
    assert runs.loc[("hs-35", "gradient"), "status"] == "not applicable"
    assert not runs.loc[("hs-35", "gradient"), "applicable"]
    assert (runs.loc[runs["applicable"], "solve_seconds"] > 0).all()
    assert reports == [("comparing", done, 9) for done in range(10)]
    assert repr(comparison) == "<Comparison of 3 solvers on 3 problems: 4 of 9 runs solved>"


def test_compare_counts_early_stop_as_false_positive(known):
    counts = known[0].summary.set_index("solver")
    assert counts.loc["hasty", "false_positives"] == 1  # on the valley
    assert counts.loc["ipopt", "false_positives"] == 0


def test_printed_comparison_is_a_table_for_each_family_in_80_columns(known):
    lines = str(known[0]).splitlines()
    assert lines[0] == "known, cold start, 3 problems"
    assert lines[1].split() == (
        ["solver", "solved", "best", "known", "mean", "ms", "95", "%", "rank", "probability"]
    )
    assert {line.split()[0] for line in lines[2:5]} == {"ipopt", "hasty", "gradient"}
    assert max(map(len, lines)) <= 80


@pytest.mark.slow
def test_report_is_written_as_page_or_as_markdown_with_figures(known, tmp_path):
    comparison = known[0]
    comparison.report(tmp_path / "new" / "report.html")
    comparison.report(str(tmp_path / "report.md"))
    page = (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    figures = {f"{name}.png" for name in make_report(comparison).figures}
    assert page.count("data:image/png;base64,") == len(figures)
    assert {path.name for path in tmp_path.glob("*.png")} == figures
    assert all(f"({name})" in text for name in figures)
    with pytest.raises(csw.ComparisonError, match=r"report.pdf'; allowed: files that end in .html"):
        comparison.report(tmp_path / "report.pdf")


def test_report_contains_every_solver(known):
    report = make_report(known[0])
    names = {"runs", "summary", "ranking", "sensitivity", "problems", "failures"}
    assert set(report.tables) == names | {"traits", "iterates"}
    kinds = ("ranking", "profiles", "bands", "wins", "convergence")
    assert set(report.figures) == {"overview", *(f"{kind}-known-cold" for kind in kinds)}
    text = report.markdown()
    headings = [line.lstrip("# ") for line in text.splitlines() if line.startswith("## ")]
    assert headings[:4] == ["Question", "Answer", "Set-up", "Results: Known, cold start"]
    assert "What would change the result" in headings
    assert "Known, cold start: " in text
    assert (
        "So few independent problems say nothing about others. Most often solved, 100 %: ipopt."
        in text
    )
    assert "those that planning and simulation pose" not in text  # of user-defined problems
    assert "gradient is not applicable to 1 run of known" in text
    assert "user-defined" in text
    page = report.html()
    assert "<h1>Comparison of solvers</h1>" in page
    assert page.count("data:image/png;base64,") == len(report.figures)
    labels = {t.get_text() for t in report.figures["overview"]().axes[0].texts}
    assert labels == {"ipopt", "hasty", "gradient"}


@pytest.mark.slow
def test_compare_verifies_copies_on_the_original():
    """A copy of the same seed is the same, and finds the optimum of its original."""
    case = published(35)
    problem = Problem("hs-35", "known", case.nlp, {"cold": case.instance})
    comparison, again = (
        csw.compare(problem, "ipopt", copies=2, seed=3, time_limit=20.0) for _ in range(2)
    )
    runs = comparison.runs
    assert runs["copy"].tolist() == [0, 1, 2]
    assert runs["high_accuracy"].all()
    assert runs["objective"].to_list() == pytest.approx([case.objective] * 3, abs=1e-7)
    assert runs["objective"].tolist() == again.runs["objective"].tolist()
    assert comparison.inputs["copies"] == 2
    text = make_report(comparison).markdown()
    assert "Every problem is also posed in 2 perturbed copies" in text
    assert "without copies" in text
    assert "known, cold start, 1 problem and 2 copies of each" in text
