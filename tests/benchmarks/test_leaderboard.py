"""The leaderboard's page is that of its table, and a row can be made again."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from commands import python

import casswarm as csw

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def leaderboard():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        import leaderboard

        yield leaderboard


@pytest.fixture(scope="module")
def table(leaderboard):
    return pd.read_csv(leaderboard.TABLE)


def test_page_is_that_of_the_table(leaderboard, table):
    assert leaderboard.PAGE.read_text(encoding="utf-8") == leaderboard.page(table)


def test_table_has_all_rows(leaderboard, table):
    rows = set(zip(table["scenario"], table["policy"], strict=True))
    names = leaderboard.names_of
    expected = {(s, p) for s in csw.builtin_scenarios() for p in names(csw.load_scenario(s))}
    assert rows == expected
    assert len(table) == len(expected)


def test_no_row_exceeds_its_bound(table):
    assert (table["success_low"] <= table["bound"]).all()
    assert (table["success_low"] <= table["success_high"]).all()
    exact = table[table["exact"]]
    assert ((exact["success_high"] - exact["success_low"]) <= 0.01 + 2e-6).all()


def test_regret_is_relative_to_the_bound(leaderboard):
    row = {"scenario": "alley", "policy": "joint", "success_low": 0.6, "success_high": 0.61}
    row |= {"exact": True, "bound": 0.8, "seconds": 1.0}
    cells = leaderboard.markdown_row(row).split(" | ")
    assert float(cells[leaderboard.COLUMNS.index("regret")]) == 0.25


def test_trained_policies_are_above_leader(table):
    rows = table.set_index(["scenario", "policy"])
    for name in ("alley", "barricade"):
        trained, leader = rows.loc[(name, "trained")], rows.loc[(name, "leader")]
        assert trained["success_low"] > leader["success_high"]


@pytest.mark.slow
def test_command_of_a_row_prints_it_again(leaderboard, table):
    row = table.set_index(["scenario", "policy"]).loc[("single-agent", "naive")]
    kept = {"scenario": "single-agent", "policy": "naive", **row}
    words = leaderboard.command(kept).split()
    done = python("-W", "error", *words[1:], folder=ROOT)
    cells, expected = (
        [cell.strip() for cell in line.strip("| \n").split("|")]
        for line in (done.stdout, leaderboard.markdown_row(kept))
    )
    time = leaderboard.COLUMNS.index("time, s")
    assert cells[:time] == expected[:time]
    assert cells[time + 1 :] == expected[time + 1 :]
    assert float(cells[time]) > 0


@pytest.mark.slow
@pytest.mark.parametrize("words", [["nowhere"], ["alley", "best"], ["alley", "naive", "again"]])
def test_wrong_arguments_are_one_line(leaderboard, words):
    done = python(leaderboard.__file__, *words, code=1)
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_own_policy_is_a_row_among_the_kept_ones(leaderboard, table, tmp_path):
    text = "def straight(scenario, guide):\n    return lambda *state: 0 * state[1] + [1.0, 0.0]\n"
    (tmp_path / "mine.py").write_text(text)
    done = python(leaderboard.__file__, "single-agent", "mine:straight", folder=tmp_path)
    lines = done.stdout.splitlines()
    assert len(lines) == 1 + (table["scenario"] == "single-agent").sum()
    assert sum("| mine:straight |" in line for line in lines) == 1
    done = python(leaderboard.__file__, "single-agent", "mine:other", folder=tmp_path, code=1)
    assert "expected module:function" in done.stderr
    assert len(done.stderr.splitlines()) == 1
