"""What commands print fits in a terminal of 80 columns."""

from __future__ import annotations

import pandas as pd
import pytest
from commands import casswarm

from casswarm.cli.output import WIDTH, aligned, wrapped
from casswarm.studies import count_notes, paired_texts, summary_texts

POLICIES = ("--policy", "constrained-feedback", "--policy", "leader-feedback")
GRID = ("--set", "formation.rho=0.05,0.1", "--set", "hazard.alpha_1=0.5,1")
COMMANDS = [
    ("plan", "ring", "--no-certify"),
    pytest.param(("plan-swarm", "paper-1", "--time-limit", 0.1), marks=pytest.mark.slow),
    pytest.param(("simulate", "paper-1", "--runs", 10, *POLICIES), marks=pytest.mark.slow),
    ("evaluate", "paper-1", "--policy", "constrained", "--max-states", 100),
    pytest.param(
        ("evaluate", "paper-1", "--policy", "leader", "--max-states", 20, "--runs", 20),
        marks=pytest.mark.slow,
    ),
    ("sweep", "paper-1", *GRID, "--policy", "naive", "--runs", 5),
    pytest.param(
        ("compare", "--family", "quick", "--count", 1, "--solver", "sqp", "--time-limit", 60),
        marks=pytest.mark.slow,
    ),
    ("solvers",),
    ("scenarios", "list"),
]


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda a: f"{a[0]}-{len(a)}")
def test_printed_lines_fit_in_80_columns(tmp_path, arguments):
    lines = casswarm(tmp_path, *arguments).stdout.splitlines()
    assert lines
    assert [line for line in lines if len(line) > WIDTH == 80] == []


def test_wide_table_continues_below_after_its_labels():
    header = ("policy", *(f"column {k}" for k in range(10)))
    first, second = aligned([header, ("naive", *map(str, range(10)))]).split("\n\n")
    assert first.split("\n")[0].split()[-2:] == ["column", "6"]
    assert second == "policy  column 7  column 8  column 9\nnaive          7         8         9"


def test_long_line_continues_indented():
    text = wrapped(f"short\n{'word ' * 20}")
    assert text.splitlines()[0] == "short"
    assert [line[:3] for line in text.splitlines()[1:]] == ["wor", "  w"]
    assert wrapped("x" * 100) == "x" * 100


def test_usual_tables_of_a_study_are_not_divided():
    row = {"policy": "constrained", "runs": 1000, "successes": 0, "success": 0.0}
    row |= {"success_low": 0.0, "success_high": 0.0037, "survivors_mean": 12.0}
    summary = summary_texts(pd.DataFrame([row | {"arrival_step_mean": 30.0}]))
    pair = {"first": "constrained", "second": "leader", "difference": -0.003}
    pair |= {"difference_low": -0.02, "difference_high": 0.01, "first_only": 31, "second_only": 376}
    paired = paired_texts(pd.DataFrame([pair | {"p_value": 2.4e-78, "variance_ratio": 0.67}]))
    for table in (summary, paired):
        rows = [tuple(table.columns), *table.itertuples(index=False, name=None)]
        assert max(map(len, aligned(rows).splitlines())) <= WIDTH
        assert "\n\n" not in aligned(rows)


def test_notes_name_counts_that_are_not_zero():
    zero = {"infeasible": 0, "solver_failures": 0, "fallbacks": 0, "saturated": 0}
    rows = [
        {"policy": "naive", **zero},
        {"policy": "leader", **zero, "infeasible": 1, "saturated": 2},
        {"policy": "joint", **zero, "saturated": 1, "fallbacks": 3},
    ]
    assert count_notes(rows) == [
        "leader: 1 infeasible step (no feasible velocity), 2 saturated velocities (projected to "
        "the limits)",
        "joint: 3 fallbacks (Ipopt solved again), 1 saturated velocity (projected to the limits)",
    ]
    assert count_notes([{"policy": "leader", "infeasible": 0.0231}], "per run on average") == [
        "leader: 0.0231 infeasible steps per run on average (no feasible velocity)"
    ]
