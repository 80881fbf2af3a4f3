"""Figures of comparisons: curves, labels and texts of given tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from casswarm.comparison import (
    data_bands,
    data_profile,
    pairwise_profiles,
    pairwise_wins,
    performance_bands,
    performance_profile,
    rank_solvers,
)
from casswarm.figures import band_chart, pair_chart, profile_chart, ranking_chart, win_chart


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
