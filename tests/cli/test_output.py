"""What commands print: tables of at most 80 columns, and progress on standard error."""

from __future__ import annotations

import io
import json
import re
import sys
import time

import pandas as pd
import pytest
from commands import casswarm

import casswarm as csw
from casswarm._util.text import WIDTH, aligned, wrapped
from casswarm.cli import output as module
from casswarm.cli.output import progress_report
from casswarm.studies import count_notes, paired_texts, summary_texts


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
        assert max(map(len, aligned(rows).splitlines())) <= WIDTH == 80
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


# --- progress


class Terminal(io.StringIO):
    """Standard error on a terminal."""

    def isatty(self):
        return True


def test_drawing_is_counted_in_a_bar_on_terminals(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with progress_report(quiet=False) as report:
        for done in range(9):
            time.sleep(0.12)  # bars are drawn at most ten times a second
            report("drawing figures", done, 8)
    assert "drawing figures 3 of 8:  38%|" in terminal.getvalue()


def test_drawing_is_one_line_elsewhere(capsys):
    with progress_report(quiet=False) as report:
        for done in range(9):
            report("drawing figures", done, 8)
    assert capsys.readouterr().err == "drawing figures: 8\n"


@pytest.mark.slow
def test_task_that_takes_long_says_for_how_long(monkeypatch, capsys):
    monkeypatch.setattr(module, "_LONG", 0.4)
    with progress_report(quiet=False) as report:
        report("optimising straight line", 0, None)
        time.sleep(1.3)
        report("drawing figures", 8, 8)
        time.sleep(1.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "optimising straight line"
    assert re.fullmatch(r"optimising straight line: \d s so far", lines[1])
    assert lines[-1] == "drawing figures: 8"
    assert len(lines) <= 4


def test_quiet_command_has_no_progress():
    with progress_report(quiet=True) as report:
        assert report is None


@pytest.mark.slow
def test_command_says_how_many_figures_it_draws(tmp_path):
    options = ("--runs", 3, "--policy", "naive")
    assert "drawing figures: 2\n" in casswarm(tmp_path, "simulate", "single-agent", *options).stderr


def test_general_solver_reports_every_solve_with_its_number():
    scenario, reported = csw.load_scenario("single-agent").with_values({"time.dt": 1.0}), []
    csw.plan(scenario, "sqp", certify=False, progress=lambda task, *_: reported.append(task))
    solves = [task for task in reported if "by sqp" in task]
    assert solves[0].startswith("optimising straight line, solve 1 of ")
    guide = csw.plan(scenario, certify=False, progress=lambda task, *_: reported.append(task))
    assert len(solves) == len(guide.candidates)
    assert not any("by ipopt" in task for task in reported)


def test_verbose_plan_shows_ipopt_and_loggers_on_standard_error(tmp_path):
    options = ("--verbose", "--json", "--no-certify", "--no-figures")
    done = casswarm(tmp_path, "plan", "single-agent", *options)
    assert json.loads(done.stdout)["command"] == "plan"
    assert "iter    objective    inf_pr" in done.stderr
    assert "\ncasswarm.guide.multistart: straight line, 30 steps: solved by ipopt" in done.stderr
    silent = casswarm(tmp_path, "plan", "single-agent", *options[1:])
    assert "multistart" not in silent.stderr
    assert "inf_pr" not in silent.stderr
