"""Progress on standard error: what is done, how much of it, and for how long."""

from __future__ import annotations

import io
import json
import re
import sys
import time

import pytest
from commands import casswarm

import casswarm as csw
from casswarm.cli import output as module
from casswarm.cli.output import progress_report


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


def test_task_that_takes_long_says_for_how_long(monkeypatch, capsys):
    monkeypatch.setattr(module, "_LONG", 0.4)
    with progress_report(quiet=False) as report:
        report("optimizing straight line", 0, None)
        time.sleep(1.3)
        report("drawing figures", 8, 8)
        time.sleep(1.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "optimizing straight line"
    assert re.fullmatch(r"optimizing straight line: \d s so far", lines[1])
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
    assert solves[0].startswith("optimizing straight line, solve 1 of ")
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
