"""Ranks of solvers from tables of runs, and profiles with bands."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from solver_runs import run

from casswarm.comparison import (
    Tolerances,
    costs,
    data_bands,
    data_profile,
    make_problems,
    performance_bands,
    performance_profile,
    rank_solvers,
    summary,
    verify,
)
from casswarm.comparison.profiles import quality_profile
from casswarm.comparison.ranking import (
    pooled_ranking,
    rank_note,
    ranking,
    sampling_units,
    sensitivity,
    strata,
)
from casswarm.comparison.report import comparison_text
from casswarm.comparison.verification import by_solver
from casswarm.figures import ranking_chart

INF = np.inf
NAMES = [f"p{k}" for k in range(12)]


def times(**columns: object) -> pd.DataFrame:
    return pd.DataFrame(columns, index=pd.Index(NAMES, name="problem"))


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """quick is faster but builds longer, and is less exact; its objective of p0 is worse."""
    exact = {"solve_seconds": 0.2, "relative_error": 1e-9, "build_seconds": 0.0}
    quick = {"solve_seconds": 0.1, "relative_error": 1e-5, "build_seconds": 1.0}
    rows = [
        row
        for problem in NAMES
        for copy in range(3)
        for row in (
            run(problem, "exact", copy=copy, **exact),
            run(problem, "quick", objective=1.5 if problem == "p0" else 1.0, copy=copy, **quick),
        )
    ]
    return verify(pd.DataFrame(rows), Tolerances())


# --- ranks


def test_rank_solvers_of_dominant_solver_is_certain() -> None:
    ranked = rank_solvers(times(slow=np.full(12, 0.4), fast=np.linspace(0.1, 0.2, 12)), 2.0)
    columns = ["solver", "rank", "probability", "rank_low", "rank_high"]
    assert ranked[columns].to_numpy().tolist() == [["fast", 1, 1, 1, 1], ["slow", 2, 1, 2, 2]]
    slow = ranked.iloc[1]
    assert slow[["mean_ms", "mean_ms_low", "mean_ms_high"]].tolist() == pytest.approx([400] * 3)


def test_rank_solvers_that_are_equal_share_their_ranks() -> None:
    seconds = np.linspace(0.1, 0.2, 12)
    ranked = rank_solvers(times(a=seconds, b=seconds), 2.0)
    found = ranked[["rank", "probability", "rank_low", "rank_high"]].to_numpy()
    np.testing.assert_allclose(found, [[1.5, 0.5, 1, 2]] * 2, rtol=1e-6)


def test_rank_solvers_counts_failures_and_slow_runs_at_the_limit() -> None:
    seconds = times(a=np.full(12, INF), b=np.full(12, 5.0))
    assert rank_solvers(seconds, 2.0)["mean_ms"].tolist() == pytest.approx([2000, 2000])
    assert rank_solvers(seconds, 2.0, 20.0)["mean_ms"].tolist() == pytest.approx([2e4, 2e4])


def test_rank_solvers_of_few_problems_has_no_probability() -> None:
    names = [name for name in NAMES[:7] for _ in range(2)]
    seconds = pd.DataFrame({"a": np.full(14, 0.1), "b": np.full(14, 0.3)}, index=names)
    ranked = rank_solvers(seconds, 2.0)
    assert ranked["rank"].tolist() == [1, 2]
    assert ranked[["probability", "mean_ms_low", "rank_high"]].isna().all(axis=None)


def test_rank_solvers_interval_shrinks_with_problems_not_with_copies() -> None:
    seconds = np.random.default_rng(0).lognormal(-2, 1, 12)
    once = rank_solvers(times(a=seconds), 10.0)
    copied = rank_solvers(pd.DataFrame({"a": np.repeat(seconds, 4)}, np.repeat(NAMES, 4)), 10.0)
    pd.testing.assert_frame_equal(copied, once)
    widths = []
    for times_12 in (4, 64):
        names = [f"p{k}" for k in range(12 * times_12)]
        ranked = rank_solvers(pd.DataFrame({"a": np.tile(seconds, times_12)}, names), 10.0)
        widths.append(np.log(ranked["mean_ms_high"] / ranked["mean_ms_low"]).iloc[0])
    assert widths[0] / widths[1] == pytest.approx(4, rel=0.15)


def test_pooled_ranking_takes_a_problem_with_all_of_its_starts_as_one_unit() -> None:
    rng = np.random.default_rng(1)
    seconds = {name: rng.lognormal(-2, 1, 2) for name in NAMES}
    rows = [
        run(problem, solver, start=start, solve_seconds=taken, build_seconds=0.0)
        for start in ("cold", "warm", "far")
        for problem, both in seconds.items()
        for solver, taken in zip(("a", "b"), both, strict=True)
    ]
    table = verify(pd.DataFrame(rows), Tolerances())
    pooled = pooled_ranking(table, 10.0)
    assert pooled["starts"].tolist() == [3, 3]
    one_start = ranking(table[table["start"] == "cold"], 10.0)
    shared = list(pooled.columns.drop("starts"))
    pd.testing.assert_frame_equal(pooled[shared], one_start[shared])
    slower = table["solve_seconds"].where(table["start"] != "far", 2 * table["solve_seconds"])
    means = pooled_ranking(table.assign(solve_seconds=slower), 10.0)["mean_ms"]
    assert (means > pooled["mean_ms"]).all()
    partly = table[~((table["solver"] == "b") & (table["start"] == "far"))]
    assert pooled_ranking(partly, 10.0)["solver"].tolist() == ["a"]


def test_rank_solvers_intervals_contain_the_mean_and_end_at_the_limit() -> None:
    once = np.where(np.arange(12) < 1, 0.02, INF)
    ranked = rank_solvers(times(once=once, never=np.full(12, INF)), 2.0)
    assert (ranked["mean_ms_low"] <= ranked["mean_ms"]).all()
    assert (ranked["mean_ms"] <= ranked["mean_ms_high"]).all()
    assert ranked["mean_ms_high"].tolist() == pytest.approx([2000, 2000])


def test_rank_solvers_interval_of_formations_excludes_differences_of_sizes() -> None:
    rng = np.random.default_rng(4)
    kinds = ["leader-5-saturation", "leader-20-saturation", "constrained-50-collision"]
    names = [f"{kind}-{number}" for kind in kinds for number in range(4)]
    seconds = pd.DataFrame({"a": np.repeat([0.01, 0.1, 1.0], 4) * rng.uniform(1, 1.2, 12)}, names)
    stratified, pooled = (
        rank_solvers(seconds, 2.0, family=family).iloc[0] for family in ("formations", "others")
    )
    widths = [row["mean_ms_high"] / row["mean_ms_low"] for row in (stratified, pooled)]
    assert widths[0] < 1.2
    assert widths[1] > 4


def test_rank_solvers_counts_guides_with_the_same_radars_once() -> None:
    rng = np.random.default_rng(5)

    def guides(fields: int) -> pd.DataFrame:
        names = [f"guide-{steps}-{field}" for field in range(fields) for steps in (30, 100, 300)]
        return pd.DataFrame({"a": rng.uniform(0.1, 0.2, len(names))}, names)

    assert rank_solvers(guides(7), 2.0, family="guides")["probability"].isna().all()  # of 21
    assert rank_solvers(guides(8), 2.0, family="guides")["probability"].tolist() == [1.0]


def test_strata_and_sampling_units_are_those_of_names_of_random_families() -> None:
    states = ["leader-5-saturation-0", "leader-5-saturation-1"]
    other = ["constrained-20-collision-0", "constrained-20-collision-1"]
    kinds = ["leader-5-saturation"] * 2 + ["constrained-20-collision"] * 2
    assert sampling_units("formations", states + other) == states + other
    assert strata("formations", states + other) == kinds
    assert strata("formations", [*states, other[0]]) == ["", "", ""]  # one of a kind
    assert strata("ring formations", states + other) == [""] * 4
    guides = ["guide-30-0", "guide-100-0", "guide-30-1", "another"]
    assert sampling_units("guides", guides) == ["0", "0", "1", "another"]
    assert sampling_units("own", guides) == guides


@pytest.mark.slow
def test_random_families_have_the_names_that_strata_are_made_of() -> None:
    problems = make_problems("quick", 2)
    for family, number, kinds in (("guides", 2, 1), ("formations", 8, 4)):
        units = sampling_units(family, [p.name for p in problems if p.family == family])
        assert len(set(units)) == number
        assert len(set(strata(family, units))) == kinds


def test_ranking_has_a_row_per_group_and_solver(table: pd.DataFrame) -> None:
    ranked = ranking(table, 2.0)
    assert ranked[["family", "start", "solver", "rank"]].to_numpy().tolist() == [
        ["f", "cold", "quick", 1.0],
        ["f", "cold", "exact", 2.0],
    ]
    pd.testing.assert_frame_equal(ranked, ranking(table, 2.0))


def test_sensitivity_names_what_changes_the_first_rank(table: pd.DataFrame) -> None:
    changed = sensitivity(table, 2.0).set_index("criterion")
    others = "mean solve time", "a quarter of the time limit", "failures count as 10 time limits"
    others += "best known objective required", "solved to low accuracy", "without copies"
    exact = dict.fromkeys(("with building", "solved to high accuracy"), "exact")
    assert changed["first"].to_dict() == exact | dict.fromkeys(others, "quick")
    assert changed.loc["with building", "rank"] == 2
    assert changed.loc["mean solve time", "probability"] == 1


# --- verification


def test_verify_tests_relative_error_at_two_tolerances(table: pd.DataFrame) -> None:
    quick = table[table["solver"] == "quick"]
    assert quick["low_accuracy"].all()
    assert not quick["high_accuracy"].any()
    strict = verify(table, Tolerances(low_accuracy=1e-6))
    assert not strict.loc[strict["solver"] == "quick", "low_accuracy"].any()


def test_verify_quality_is_one_at_the_best_and_less_by_the_gap(table: pd.DataFrame) -> None:
    qualities = by_solver(table, "f", "cold", "quality")
    assert qualities["exact"].tolist() == [1.0] * 36
    assert qualities["quick"].tolist() == [0.5] * 3 + [1.0] * 33


def test_summary_counts_problems_and_runs(table: pd.DataFrame) -> None:
    counts = summary(table, 2.0).set_index("solver")
    assert counts.loc["quick", ["problems", "runs", "true_positives"]].tolist() == [12, 36, 36]
    assert counts.loc["quick", ["low_accuracy", "high_accuracy"]].tolist() == [1, 0]


def test_costs_of_copies_share_the_problem_as_index(table: pd.DataFrame) -> None:
    seconds = costs(table, "f", "cold", "solve_seconds")
    assert seconds.index.tolist() == [name for name in NAMES for _ in range(3)]


# --- profiles with bands


def test_bands_contain_their_profiles() -> None:
    rng = np.random.default_rng(1)
    seconds = times(a=rng.lognormal(size=12), b=rng.lognormal(size=12), c=np.full(12, INF))
    for profile, (low, high) in (
        (performance_profile(seconds), performance_bands(seconds)),
        (data_profile(seconds, 2.0), data_bands(seconds, 2.0)),
    ):
        assert low.index.equals(profile.index)
        assert low.columns.equals(profile.columns)
        assert ((low <= profile) & (profile <= high)).all(axis=None)
        assert (high["c"] < 0.5).all()


def test_bands_of_copies_are_those_of_their_problems() -> None:
    seconds = times(a=np.linspace(1, 2, 12), b=np.linspace(2, 1, 12))
    copied = seconds.loc[seconds.index.repeat(3)]
    for once, thrice in zip(performance_bands(seconds), performance_bands(copied), strict=True):
        pd.testing.assert_frame_equal(once, thrice)


def test_bands_without_a_solved_problem_are_drawn_from_nothing() -> None:
    nothing = times(a=np.full(12, INF))
    low, high = performance_bands(nothing)
    assert low.loc[1.0, "a"] == 0
    assert 0 < high.loc[1.0, "a"] < 0.5
    assert all(band.empty for band in data_bands(nothing))


def test_quality_profile_equals_hand_calculation() -> None:
    seconds = pd.DataFrame({"a": [1.0, 4.0], "b": [2.0, INF]})
    quality = pd.DataFrame({"a": [1.0, 0.5], "b": [0.8, 0.9]})
    profile = quality_profile(seconds, quality)
    assert profile.index.tolist() == [1, 2, 4]
    assert profile["a"].tolist() == [0.5, 0.5, 0.75]
    assert profile["b"].tolist() == [0, 0.4, 0.4]


# --- what probabilities of ranks are


@pytest.mark.parametrize(("problems", "noted"), [(7, False), (8, True), (29, True), (30, False)])
def test_probabilities_of_ranks_are_noted_as_overconfident_below_thirty_problems(
    problems: int, noted: bool
) -> None:
    rows = [
        run(f"p{k}", solver, copy=copy, solve_seconds=seconds)
        for k in range(problems)
        for copy in range(2)  # of the same problem, which do not count
        for solver, seconds in (("quick", 0.1), ("slow", 0.2 + 0.01 * k))
    ]
    verified = verify(pd.DataFrame(rows), Tolerances())
    ranked = ranking(verified, 2.0)
    assert ranked["independent"].tolist() == [problems] * 2
    note = rank_note(ranked)
    assert ("fewer than 30 problems: probabilities of ranks are overconfident" in note) == noted
    shown = SimpleNamespace(ranking=ranked, summary=summary(verified, 2.0))
    label = ranking_chart(ranked).axes[0].get_xlabel()
    for text in (comparison_text(shown), label):  # type: ignore[arg-type]
        assert ("overconfident" in text) == noted
