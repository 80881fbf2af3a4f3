"""Agreement of two comparisons, and comparisons in folders."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from solver_runs import run

import casswarm as csw
from casswarm.comparison import Comparison, Tolerances, make_report, verify

MEASURED = {"relative_error": 1e-9, "build_seconds": 1e-3, "time_ratio": 1.0}
PROBLEMS = [f"p{number}" for number in range(8)]


def made(seconds: dict[str, float], seed: int = 0, problems: list[str] = PROBLEMS) -> Comparison:
    """A comparison in which solvers solve all problems in about these times."""
    rng = np.random.default_rng(seed)
    rows = [
        run(problem, solver, solve_seconds=time * rng.uniform(0.9, 1.1), **MEASURED)
        for problem in problems
        for solver, time in seconds.items()
    ]
    inputs = {
        "families": ["f"],
        "time_limit": 2.0,
        "solvers": {name: name for name in seconds},
        "problems": dict.fromkeys(problems, "hash"),
        "tolerances": {"violation": 1e-6},
    }
    return Comparison(verify(pd.DataFrame(rows), Tolerances()), pd.DataFrame(), inputs)


def _problems() -> list[csw.Problem]:
    x = ca.SX.sym("x", 2)
    bowls = [
        csw.Problem.from_casadi({"x": x, "f": ca.sumsqr(x - k)}, f"bowl {k}") for k in range(7)
    ]
    undefined = {"x": x, "f": ca.sumsqr(ca.sqrt(x + 1e-300) - 1)}
    return [*bowls, csw.Problem.from_casadi(undefined, "undefined", x0=1, lbx=-1)]


FIRST = made({"fast": 0.01, "slow": 0.1})


def test_same_order_agrees_by_every_criterion() -> None:
    agreement = FIRST.agreement(made({"fast": 0.01, "slow": 0.1}, seed=1))
    assert agreement.agrees
    assert agreement.same_problems
    assert agreement.table["same_rank"].all()
    assert len(agreement.summary) == 7  # mean solve time, and six other criteria
    assert (agreement.summary["solvers"] == 2).all()
    assert agreement.different == {}
    assert "14 of 14 ranks in 7 rankings agree" in str(agreement)


def test_clearly_reversed_order_disagrees() -> None:
    agreement = FIRST.agreement(made({"fast": 0.1, "slow": 0.01}))
    assert not agreement.agrees
    assert set(agreement.disagreements["solver"]) == {"fast", "slow"}
    assert "fast has rank 1 (1 to 1), in the other 2 (2 to 2)" in str(agreement)


def test_reversal_within_the_error_bars_of_both_agrees() -> None:
    a, b = made({"one": 0.1, "two": 0.1}, 2), made({"one": 0.1, "two": 0.1}, 3)
    agreement = a.agreement(b)
    both = agreement.table[["rank_low", "rank_high", "rank_low_other", "rank_high_other"]]
    assert both.drop_duplicates().to_numpy().tolist() == [[1, 2, 1, 2]]
    assert agreement.agrees


def test_faster_machine_agrees_in_ranks_and_not_in_times() -> None:
    agreement = FIRST.agreement(made({"fast": 0.001, "slow": 0.01}))
    assert agreement.agrees
    assert not agreement.table["mean_within"].any()


def test_ranks_are_among_common_solvers() -> None:
    agreement = FIRST.agreement(made({"new": 0.001, "fast": 0.01, "slow": 0.1}))
    assert agreement.agrees
    assert set(agreement.table["solver"]) == {"fast", "slow"}
    assert agreement.different == {"solvers.new": (None, "new")}


def test_what_differs_is_named() -> None:
    other = replace(FIRST, inputs=FIRST.inputs | {"time_limit": 1.0, "problems": {"p0": "other"}})
    agreement = FIRST.agreement(other)
    assert agreement.different == {"time_limit": (2.0, 1.0)}
    assert not agreement.same_problems
    assert "time_limit: 2.0, in the other 1.0" in str(agreement)
    assert "the problems are not the same" in str(agreement)


def test_agreement_needs_common_solvers_and_error_bars() -> None:
    with pytest.raises(csw.ComparisonError, match="no solver on a family and start in common"):
        FIRST.agreement(made({"other": 0.1}))
    few = made({"fast": 0.01, "slow": 0.1}, problems=PROBLEMS[:2])
    with pytest.raises(csw.ComparisonError, match="too few problems"):
        few.agreement(few)


def test_saved_comparison_is_loaded_equal(tmp_path: Path) -> None:
    comparison = csw.compare(_problems(), ["ipopt"], time_limit=60)
    comparison.save(tmp_path / "study")
    loaded = Comparison.load(tmp_path / "study")
    for name in ("runs", "problems", "iterates"):
        pd.testing.assert_frame_equal(getattr(loaded, name), getattr(comparison, name))
    assert loaded.inputs == comparison.inputs
    assert loaded.agreement(comparison).agrees


@pytest.mark.slow
def test_published_comparison_without_traits_is_reported() -> None:
    published = Comparison.load(Path(__file__).parents[2] / "results" / "comparison" / "first")
    assert published.problems.groupby("family")["problem"].nunique().to_dict() == {
        "guides": 9,
        "formations": 36,
    }
    text = make_report(published).markdown()
    assert "45 problems, 9 solvers, 810 runs" in text
    assert "| guides | 9 |  |  | paths of a single agent" in text
    assert "overconfident" not in text  # 36 formations, and guides without probabilities


@pytest.mark.slow
@pytest.mark.parametrize(("problems", "noted"), [(29, True), (30, False)])
def test_report_says_below_thirty_problems_that_probabilities_are_overconfident(
    problems: int, noted: bool
) -> None:
    published = Comparison.load(Path(__file__).parents[2] / "results" / "comparison" / "first")
    formations = published.runs[published.runs["family"] == "formations"]
    some = formations["problem"].isin(formations["problem"].unique()[:problems])
    text = make_report(replace(published, runs=formations[some])).markdown()
    assert ("Fewer than 30 problems: probabilities of ranks are overconfident" in text) == noted
    assert ("of the problems (fewer than 30 problems: prob" in text) == noted


def test_load_refuses_what_is_no_comparison(tmp_path: Path) -> None:
    with pytest.raises(csw.ComparisonError, match=r"holds no comparison: it has no run\.json"):
        Comparison.load(tmp_path)
    record = tmp_path / "run.json"
    record.write_text(json.dumps({"command": "plan"}))
    with pytest.raises(csw.ComparisonError, match="written by casswarm plan"):
        Comparison.load(tmp_path)
    record.write_text(json.dumps({"command": "compare", "inputs": {"time_limit": 2.0}}))
    with pytest.raises(csw.ComparisonError, match=r"has no runs\.csv"):
        Comparison.load(tmp_path)
    (tmp_path / "runs.csv").write_text("family,problem\n")
    with pytest.raises(csw.ComparisonError, match="lacks solved, solver, start"):
        Comparison.load(tmp_path)
    record.write_text("{")
    with pytest.raises(csw.ComparisonError, match="cannot be read"):
        Comparison.load(tmp_path)
