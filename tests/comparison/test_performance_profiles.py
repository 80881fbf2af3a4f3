"""Profiles against tables worked out by hand, what must not change them, and their figures."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from casswarm.comparison import (
    data_bands,
    data_profile,
    pairwise_profiles,
    pairwise_wins,
    performance_bands,
    performance_profile,
    rank_solvers,
)
from casswarm.comparison.profiles import fraction_at, shifted_geometric_mean
from casswarm.figures import band_chart, pair_chart, profile_chart, ranking_chart, win_chart

INF = np.inf
BY_HAND = pd.DataFrame(
    {"a": [1.0, 4.0, 2.0, INF], "b": [2.0, 1.0, 2.0, INF], "c": [INF, 3.0, 8.0, INF]},
    index=["p", "q", "r", "s"],
)
"""Ratios: p 1, 2, -; q 4, 1, 3; r 1, 1, 4; nobody solves s."""

tables = arrays(
    float,
    st.tuples(st.integers(1, 6), st.integers(1, 4)),
    elements=st.sampled_from([0.5, 1, 2, 7, INF]),
).map(lambda values: pd.DataFrame(values, columns=list("abcd")[: values.shape[1]]))


def test_performance_profile_equals_hand_calculation() -> None:
    profile = performance_profile(BY_HAND)
    assert profile.index.tolist() == [1, 2, 3, 4]
    a, b, c = [0.5, 0.5, 0.5, 0.75], [0.5, 0.75, 0.75, 0.75], [0, 0, 0.25, 0.5]
    assert profile[["a", "b", "c"]].to_numpy().T.tolist() == [a, b, c]
    for at, fractions in ((0.9, [0, 0, 0]), (2.9, [0.5, 0.75, 0]), (1e9, [0.75, 0.75, 0.5])):
        assert fraction_at(profile, at).tolist() == fractions


def test_data_profile_equals_hand_calculation() -> None:
    profile = data_profile(BY_HAND, [1.0, 2.0, 2.0, 1.0])
    assert profile.index.tolist() == [0.5, 1, 1.5, 2, 4]
    a, b, c = [0, 0.5, 0.5, 0.75, 0.75], [0.25, 0.5, 0.5, 0.75, 0.75], [0, 0, 0.25, 0.25, 0.5]
    assert profile[["a", "b", "c"]].to_numpy().T.tolist() == [a, b, c]


def test_pairwise_wins_equal_hand_count_without_ties() -> None:
    wins = pairwise_wins(BY_HAND).loc[["a", "b", "c"], ["a", "b", "c"]]
    nan = np.nan
    np.testing.assert_array_equal(wins, [[nan, 0.25, 0.5], [0.25, nan, 0.75], [0.25, 0, nan]])


def test_pairwise_profile_is_independent_of_others() -> None:
    # against all three, c looks slower than a; alone they are equal
    costs = pd.DataFrame({"a": [2.0, 4.0], "b": [4.0, 1.0], "c": [4.0, 2.0]})
    alone = pairwise_profiles(costs)["a", "c"]
    assert alone.loc[1].tolist() == [0.5, 0.5]
    assert performance_profile(costs).loc[1].tolist() == [0.5, 0.5, 0]


def test_profiles_are_zero_if_all_fail() -> None:
    costs = pd.DataFrame({"a": [INF, INF], "b": [INF, INF]})
    profile = performance_profile(costs)
    assert profile.index.tolist() == [1]
    assert profile.to_numpy().tolist() == [[0, 0]]
    assert data_profile(costs).empty
    assert (pairwise_wins(costs).loc["a", "b"], pairwise_wins(costs).loc["b", "a"]) == (0, 0)


@given(tables, st.sampled_from([0.25, 2.0, 1024.0]))
def test_performance_profile_is_scale_invariant(table, factor) -> None:
    pd.testing.assert_frame_equal(performance_profile(factor * table), performance_profile(table))


@given(tables, st.randoms())
def test_profiles_are_independent_of_order(table, random) -> None:
    problems, solvers = list(table.index), list(table.columns)
    random.shuffle(problems)
    random.shuffle(solvers)
    shuffled = table.loc[problems, solvers]
    for profile in (performance_profile, data_profile):
        pd.testing.assert_frame_equal(profile(shuffled)[list(table.columns)], profile(table))


@given(tables)
def test_profiles_end_at_fraction_solved(table) -> None:
    profile = performance_profile(table)
    assert (profile.diff().dropna() >= 0).all(axis=None)
    np.testing.assert_allclose(profile.iloc[-1], np.isfinite(table).mean())
    # somebody is the fastest on every problem that anybody solves; ties count for all
    assert profile.loc[1.0].sum() >= np.isfinite(table).any(axis=1).mean() - 1e-12


@pytest.mark.parametrize(
    ("costs", "words"),
    [([], "at least one problem"), ([0.0], "above zero"), ([np.nan], "above zero")],
)
def test_profiles_reject_invalid_costs_and_units(costs: list[float], words: str) -> None:
    for function in (performance_profile, data_profile):
        with pytest.raises(ValueError, match=words):
            function(pd.DataFrame({"a": costs}))
    with pytest.raises(ValueError, match="units must be finite"):
        data_profile(BY_HAND, [1, 1, 0, 1])


def test_shifted_geometric_mean_equals_hand_calculation() -> None:
    assert shifted_geometric_mean([1.0, 7.0], 1.0) == pytest.approx(3.0)  # sqrt(2 * 8) - 1
    np.testing.assert_allclose(shifted_geometric_mean([[3.0, 0.0], [3.0, 8.0]], 1.0), [3.0, 2.0])
    assert shifted_geometric_mean([1.0, INF], 1.0) == INF
    for values, shift in (([-1.0], 1.0), ([1.0], 0.0)):
        with pytest.raises(ValueError, match="shift"):
            shifted_geometric_mean(values, shift)


# --- figures


def test_profile_charts_draw_given_values():
    table = pd.DataFrame({"a": [1.0, 2.0, np.inf], "b": [2.0, 1.0, 4.0]})
    fig = profile_chart({"one": performance_profile(table)}, "factor", "title", ["b", "a"])
    curve = next(line for line in fig.axes[0].lines if line.get_label() == "a")
    assert curve.get_ydata().tolist()[1:] == [1 / 3, 2 / 3, 2 / 3]
    assert len(pair_chart(pairwise_profiles(table)).axes) == 1
    matrix = win_chart(pairwise_wins(table))
    assert [t.get_text() for t in matrix.axes[0].texts] == ["33 %", "67 %"]


def test_band_chart_has_a_panel_per_solver(tmp_path):
    table = pd.DataFrame({"a": [1.0, 2.0, np.inf, 1.0], "b": [2.0, 1.0, 4.0, 3.0]})
    fig = band_chart(performance_profile(table), performance_bands(table), "factor", "title")
    assert [axes.get_title() for axes in fig.axes] == ["a", "b"]
    nothing = pd.DataFrame({"a": [np.inf]})
    band_chart(data_profile(nothing), data_bands(nothing), "budget").savefig(tmp_path / "no.png")


def test_ranking_chart_states_rank_and_probability():
    costs = pd.DataFrame({"slow": np.full(8, 0.5), "fast": np.full(8, 0.1)}, list("pqrstuvw"))
    texts = [text.get_text() for text in ranking_chart(rank_solvers(costs, 2.0)).axes[0].texts]
    assert texts == ["rank 1 (100 %)", "rank 2 (100 %)"]
    few = ranking_chart(rank_solvers(costs.iloc[:1], 2.0))
    assert [text.get_text() for text in few.axes[0].texts] == ["rank 1", "rank 2"]


def test_profile_chart_without_solved_problem_is_drawn(tmp_path):
    nothing = pd.DataFrame({"a": [np.inf], "b": [np.inf]})
    fig = profile_chart({"one": performance_profile(nothing)}, "factor")
    fig.savefig(tmp_path / "nothing.png")
