"""What every command does that computes: it fits in a terminal, its columns are explained, and its
figures can be left out and drawn later.
"""

from __future__ import annotations

import pytest
from commands import SMALL_SIMULATION, casswarm
from glossary import unexplained

POLICIES = ("--policy", "constrained-feedback", "--policy", "leader-feedback")
GRID = ("--set", "formation.rho=0.05,0.1", "--set", "hazard.alpha_1=0.5,1")
QUICK = ("--family", "quick", "--count", 1, "--time-limit", 60)
COMMANDS = [
    ("plan", "ring", "--no-certify"),
    ("plan-swarm", "single-agent"),
    SMALL_SIMULATION,
    ("evaluate", "single-agent"),
    ("evaluate", "paper-1", "--policy", "constrained", "--max-states", 100),
    ("sweep", "paper-1", *GRID, "--policy", "naive", "--runs", 5),
]
SLOW = [
    ("plan", "paper-1", "--solver", "projected-gradient"),
    ("plan-swarm", "paper-1", "--time-limit", 0.1),
    ("simulate", "paper-1", "--runs", 10, *POLICIES),
    ("evaluate", "paper-1", "--policy", "leader", "--max-states", 20, "--runs", 20),
    ("sweep", "single-agent", "--set", "n=1,2", "--policy", "leader"),
    ("compare", *QUICK, "--solver", "sqp"),
    ("compare", *QUICK, "--solver", "spectral"),
]


@pytest.fixture(
    params=[*COMMANDS, *(pytest.param(command, marks=pytest.mark.slow) for command in SLOW)],
    ids=lambda command: "-".join(map(str, command[:3])),
)
def undrawn(request, finished):
    """Results folder of a command that draws nothing, and what it printed."""
    return finished(*request.param, "--no-figures")


def test_printed_lines_fit_in_80_columns(undrawn):
    lines = undrawn[1].stdout.splitlines()
    assert lines
    assert [line for line in lines if len(line) > 80] == []


@pytest.mark.parametrize("arguments", [("solvers",), ("scenarios", "list")])
def test_printed_lists_fit_in_80_columns(tmp_path, arguments):
    test_printed_lines_fit_in_80_columns((tmp_path, casswarm(tmp_path, *arguments)))


def test_glossary_has_every_column_that_command_writes(undrawn):
    folder, done = undrawn
    tables = list(folder.glob("*.csv"))
    assert tables
    given = {str(word).partition("=")[0] for word in done.args}  # keys that a sweep was given
    assert {name for missing in unexplained(tables).values() for name in missing} <= given


def test_command_without_figures_draws_none_and_plot_draws_them(undrawn, tmp_path):
    folder, done = undrawn
    assert "drawing" not in done.stderr
    assert (folder / "run.json").exists()
    assert not list(folder.glob("*.png"))
    casswarm(tmp_path, "plot", folder, "--out", "here")
    assert list((tmp_path / "here").glob("*.png"))
