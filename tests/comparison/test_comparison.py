"""Comparisons: problems that are the same for the same seed, verdicts, figures, the report."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest
from known_problems import active_box, hs_1, hs_35, nearest_in_box

import casswarm as csw
from casswarm.comparison import Problem, make_problems
from casswarm.comparison.profiles import pairwise_profiles, pairwise_wins, performance_profile
from casswarm.comparison.rendering import Heading, Table, html, markdown
from casswarm.comparison.report import make_report
from casswarm.comparison.verification import (
    Tolerances,
    by_problem,
    costs,
    failures,
    judged,
    summary,
)
from casswarm.errors import ComparisonError, SolverError
from casswarm.figures import pair_chart, profile_chart, win_chart
from casswarm.optimization.solvers import Ipopt, ProjectedGradient

# --- problems


@pytest.fixture(scope="module")
def quick():
    return make_problems("quick")


def test_the_same_seed_makes_the_same_problems_and_another_seed_others(quick):
    again, other = make_problems("quick"), make_problems("quick", seed=1)
    assert [p.name for p in again] == [p.name for p in quick] == [p.name for p in other]
    assert [p.fingerprint() for p in again] == [p.fingerprint() for p in quick]
    assert not {p.fingerprint() for p in other} & {p.fingerprint() for p in quick}


def test_problems_survive_a_journey(quick):
    for problem in quick:
        again = pickle.loads(pickle.dumps(problem))
        assert again.fingerprint() == problem.fingerprint()
        assert again.traits == problem.traits


def test_starts_are_of_one_problem_and_differ(quick):
    for problem in quick:
        cold, warm = problem.starts["cold"], problem.starts["warm"]
        assert not np.array_equal(cold.x0, warm.x0)
        for part in ("p", "lbx", "ubx", "lbg", "ubg"):
            np.testing.assert_array_equal(getattr(cold, part), getattr(warm, part))
    assert {p.family for p in quick} == {"guides", "formations"}


def test_states_of_formations_have_something_to_decide(quick):
    for problem in quick:
        if problem.family == "formations":
            instance = problem.starts["warm"]
            assert (instance.ubx > instance.lbx).any()
            solution = Ipopt().solve(problem.nlp, instance)[0]
            assert solution.status.success


def test_wrong_families_counts_and_names_are_answered_with_the_right_ones(quick):
    with pytest.raises(ComparisonError, match="did you mean 'guides'"):
        make_problems("guidess")
    with pytest.raises(ComparisonError, match="problems = 0; allowed"):
        make_problems("guides", 0)
    with pytest.raises(
        ComparisonError, match=r"families must be a list; for a single one give \['"
    ):
        csw.compare("quick")
    with pytest.raises(ComparisonError, match="solvers must be a list"):
        csw.compare([quick[0]], "ipopt")
    with pytest.raises(ComparisonError, match="solvers of the same name: ipopt; give a mapping"):
        csw.compare([quick[0]], [Ipopt(), Ipopt(tolerance=1e-4)])
    with pytest.raises(ComparisonError, match="problems of the same name: guide-10-0"):
        csw.compare([quick[0], quick[0]], ["ipopt"])
    with pytest.raises(ComparisonError, match="has 2 instances as its cold start"):
        Problem("two", "boxes", *nearest_in_box(np.zeros((2, 2)))[:1], {"cold": two()})
    with pytest.raises(ComparisonError, match="seconds = 0"):
        csw.compare([quick[0]], ["ipopt"], seconds=0)
    with pytest.raises(SolverError, match="did you mean 'ipopt'"):
        csw.compare([quick[0]], ["ipop"])
    with pytest.raises(ComparisonError, match="tolerance objective = -1"):
        Tolerances(objective=-1)


def two():
    return nearest_in_box(np.zeros((2, 2)))[1]


# --- verdicts, on a table made by hand


def cell(problem, solver, claim="solved", objective=1.0, seconds=0.1, **others):
    return {
        "family": "f",
        "problem": problem,
        "start": "cold",
        "solver": solver,
        "claim": claim,
        "status": claim,
        "words": "words",
        "objective": objective,
        "violation": 0.0,
        "worst": "",
        "stationarity": 0.0,
        "complementarity": 0.0,
        "iterations": 5,
        "evaluations": 6,
        "build_seconds": 0.01,
        "solve_seconds": seconds,
        "solves": 1,
        "spread": np.nan,
        "unit": 1.0,
        "gradient_seconds": 1e-5,
    } | others


CELLS = pd.DataFrame(
    [
        cell("p", "good", objective=2.0),
        cell("p", "local", objective=2.1),
        cell("p", "liar", objective=1.0, violation=0.5, worst="budget[0]"),
        cell("p", "shy", "iteration limit", objective=2.0),
        cell("p", "lost", "failed", objective=np.nan, violation=np.inf, stationarity=np.inf),
        cell("p", "picky", "cannot take", np.nan, np.nan, violation=np.nan, stationarity=np.nan),
        cell("q", "good", objective=3.0, seconds=0.4),
        cell("q", "local", objective=3.0, seconds=0.2),
        cell("q", "liar", objective=3.0, stationarity=1.0),
        cell("q", "shy", objective=3.0 + 1e-5),
        cell("q", "lost", "time limit", objective=2.9, stationarity=1.0),
        cell("q", "picky", "cannot take", np.nan, np.nan, violation=np.nan, stationarity=np.nan),
    ]
)


@pytest.fixture(scope="module")
def table():
    return judged(CELLS, Tolerances()).set_index(["problem", "solver"], drop=False)


def test_best_known_is_the_least_objective_of_a_feasible_answer(table):
    assert table.loc["p", "best"].tolist() == [2.0] * 6  # not the liar's 1, which is infeasible
    assert table.loc["q", "best"].tolist() == [2.9] * 6  # that of a time limit counts, if feasible
    assert table.loc[("p", "local"), "gap"] == pytest.approx(0.05)


def test_solved_is_said_and_true(table):
    assert table.index[table["solved"]].tolist() == [
        ("p", "good"), ("p", "local"), ("q", "good"), ("q", "local"), ("q", "shy"),
    ]  # fmt: skip
    assert table.index[table["found"]].tolist() == [("p", "good")]
    assert table.loc[("p", "shy"), "true"]
    assert not table.loc[("p", "shy"), "said"]


def test_reasons_name_what_is_wrong(table):
    reasons = table["reason"]
    assert reasons["p", "good"] == ""
    assert reasons["p", "liar"] == "called solved, but violation 5.0e-01 (budget[0]) > 1e-06"
    assert reasons["q", "liar"] == "called solved, but stationarity 1.0e+00 > 0.0001"
    assert reasons["p", "shy"] == "iteration limit: words"


def test_summary_counts_words_against_truth(table):
    found = summary(table.reset_index(drop=True), limit=10.0).set_index("solver")
    assert "picky" not in found.index  # takes nothing of the family
    words = ["said_and_true", "said_not_true", "true_not_said", "neither"]
    assert found.loc["good", words].tolist() == [2, 0, 0, 0]
    assert found.loc["liar", words].tolist() == [0, 2, 0, 0]
    assert found.loc["shy", words].tolist() == [1, 0, 1, 0]
    assert found.loc["lost", words].tolist() == [0, 0, 0, 2]
    assert found.loc["good", "mean_ms"] == pytest.approx(1e3 * (np.sqrt(0.101 * 0.401) - 0.001))
    assert found.loc["lost", "mean_ms"] == pytest.approx(10_000)


def test_costs_of_failures_are_infinite_and_strangers_left_out(table):
    times = costs(table.reset_index(drop=True), "f", "cold", "solve_seconds")
    assert times.columns.tolist() == ["good", "local", "liar", "shy", "lost"]
    assert times.loc["p"].tolist() == [0.1, 0.1, np.inf, np.inf, np.inf]
    found = costs(table.reset_index(drop=True), "f", "cold", "solve_seconds", "found")
    assert np.isfinite(found).to_numpy().sum() == 1


def test_a_problem_that_a_solver_cannot_take_counts_if_it_takes_another():
    cells = CELLS.copy()
    cells.loc[5] = pd.Series(cell("p", "picky"))
    times = costs(judged(cells, Tolerances()), "f", "cold", "solve_seconds")
    assert times["picky"].tolist() == [0.1, np.inf]


def test_problems_and_failures_are_told_one_by_one(table):
    plain = table.reset_index(drop=True)
    problems = by_problem(plain).set_index("problem")
    assert problems.loc["q", ["taken", "solved", "found"]].tolist() == [5, 3, 0]
    assert problems.loc["q", "fastest"] == "shy"
    assert problems.loc["p", "worst_gap"] == pytest.approx(0.05)
    bad = failures(plain)
    assert set(bad["solver"]) == {"liar", "shy", "lost"}
    assert bad["cells"].sum() == 5


# --- a comparison of known problems


@pytest.fixture(scope="module")
def known():
    cases = {"corner": active_box(), "valley": hs_1(), "hs-35": hs_35()}
    problems = [
        Problem(name, "known", case.nlp, {"cold": case.instance}) for name, case in cases.items()
    ]
    told = []
    comparison = csw.compare(
        problems,
        {
            "ipopt": "ipopt",
            "hasty": ProjectedGradient(tolerance=1e3),
            "gradient": ProjectedGradient(),
        },
        seconds=20.0,  # where the machine is busy
        progress=lambda *words: told.append(words),
    )
    return comparison, told, cases


def test_known_optima_are_found_and_judged(known):
    comparison, told, cases = known
    cells = comparison.cells.set_index(["problem", "solver"])
    for name, case in cases.items():
        assert cells.loc[(name, "ipopt"), "solved"]
        assert cells.loc[(name, "ipopt"), "objective"] == pytest.approx(case.objective, abs=1e-6)
    assert cells.loc[("hs-35", "gradient"), "status"] == "cannot take"
    assert not cells.loc[("hs-35", "gradient"), "taken"]
    assert (cells.loc[cells["taken"], "solve_seconds"] > 0).all()
    assert [done for done, total, _ in told] == list(range(10))


def test_a_solver_that_stops_too_early_is_seen(known):
    counts = known[0].summary.set_index("solver")
    assert counts.loc["hasty", "said_not_true"] == 1  # the valley
    assert counts.loc["ipopt", "said_not_true"] == 0


def test_report_and_figures_hold_every_solver(known):
    report = make_report(known[0])
    assert set(report.tables) == {"cells", "summary", "problems", "failures"}
    assert set(report.figures) == {f"{k}-known-cold" for k in ("profile", "data", "pairs", "wins")}
    text = report.markdown()
    assert "gradient takes no part in 1 cells of known" in text
    assert "given by the user" in text
    labels = {t.get_text() for t in report.figures["profile-known-cold"].axes[0].texts}
    assert labels == {"ipopt", "hasty", "gradient"}


# --- figures and renderings


def test_figures_draw_what_they_are_given():
    table = pd.DataFrame({"a": [1.0, 2.0, np.inf], "b": [2.0, 1.0, 4.0]})
    fig = profile_chart({"one": performance_profile(table)}, "factor", "title", ["b", "a"])
    curve = next(line for line in fig.axes[0].lines if line.get_label() == "a")
    assert curve.get_ydata().tolist()[1:] == [1 / 3, 2 / 3, 2 / 3]
    assert len(pair_chart(pairwise_profiles(table)).axes) == 1
    matrix = win_chart(pairwise_wins(table))
    assert [t.get_text() for t in matrix.axes[0].texts] == ["33 %", "67 %"]


def test_figures_of_nothing_solved_are_drawn_too(tmp_path):
    nothing = pd.DataFrame({"a": [np.inf], "b": [np.inf]})
    fig = profile_chart({"one": performance_profile(nothing)}, "factor")
    fig.savefig(tmp_path / "nothing.png")


def test_tables_are_rendered_with_what_is_special_escaped():
    blocks = [Heading("A < B", 1), Table(pd.DataFrame({"x|y": ["a|b"], "n": ["1.5 %"]}))]
    assert markdown(blocks) == "# A < B\n\n| x\\|y | n |\n| :-- | --: |\n| a\\|b | 1.5 % |\n"
    page = html(blocks)
    assert "<h1>A &lt; B</h1>" in page
    assert "<td class=n>1.5 %</td>" in page
