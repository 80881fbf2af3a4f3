"""Code of users that fails in a command: one line with its place, and exit code 1."""

from __future__ import annotations

import pytest
from commands import casswarm

POLICIES = """
import sys
import time

import numpy as np

def dividing(step, positions, previous_velocities, alive):
    return positions / (1 // step)

def leaving(step, positions, previous_velocities, alive):
    sys.exit(0)

def endless(step, positions, previous_velocities, alive):
    while step > 1:
        pass
    return 0 * positions
"""
HAZARD = """
import sys

def leaving(positions, alive):
    sys.exit(0)

def moving(positions, alive):
    return 0.1 + 0 * positions[:, 0]
"""
SCENARIO = """
name = "mine"
[swarm]
positions = [[0.0, 0.0]]
v_max = 2.0
a_max = 0.5
[target]
center = [3.0, 0.0]
radius = 0.5
[time]
dt = 0.33
t_f = 3.3
[hazard]
kind = "rates:leaving"
"""
FAILING = {
    "dividing": (
        "policy 'dividing' failed at step 0: ZeroDivisionError: integer division or modulo by "
        "zero (mine.py:8)"
    ),
    "leaving": "policy 'leaving' failed at step 0: SystemExit: sys.exit(0) (mine.py:11)",
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(POLICIES)
    return tmp_path


@pytest.mark.parametrize("command", ["simulate", "evaluate"])
@pytest.mark.parametrize("name", FAILING)
def test_failing_policy_is_one_line_with_users_line(folder, command, name):
    options = (command, "single-agent", "--policy", f"mine:{name}", "--quiet")
    done = casswarm(folder, *options, code=1)
    assert done.stderr == f"Error: {FAILING[name]}\n"


@pytest.mark.parametrize("workers", [1, 2])
def test_policy_beyond_its_time_limit_is_one_line(folder, workers):
    options = ("--policy", "mine:endless", "--policy-time-limit", 0.5, "--workers", workers)
    done = casswarm(folder, "simulate", "single-agent", "--runs", 4, "--quiet", *options, code=1)
    assert "policy 'endless' took longer than its time limit of 0.5 s at step 2" in done.stderr
    assert done.stderr.count("\n") == 1


def test_module_of_policy_that_exits_is_explained(folder):
    (folder / "quits.py").write_text("import sys\nsys.exit(0)\n")
    done = casswarm(folder, "simulate", "single-agent", "--policy", "quits:policy", code=2)
    assert (
        "cannot import the module 'quits' of 'quits:policy': SystemExit: sys.exit(0) (quits.py:2)"
        in done.stderr
    )


def test_hazard_that_exits_is_not_valid(tmp_path):
    (tmp_path / "rates.py").write_text(HAZARD)
    (tmp_path / "mine.toml").write_text(SCENARIO)
    done = casswarm(tmp_path, "scenarios", "check", "mine.toml", "--allow-code", code=2)
    assert "valid" not in done.stdout
    assert "SystemExit: sys.exit(0) (rates.py:5)" in done.stderr


@pytest.mark.parametrize("command", ["simulate", "evaluate", "sweep"])
@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ("--policy", "leeder", "policy 'leeder' is unknown; did you mean 'leader'"),
        ("--solver", "spectrall", "solver 'spectrall' is unknown; did you mean 'spectral'"),
    ],
)
def test_misspelt_name_is_found_before_planning(tmp_path, command, option, name, words):
    swept = ("--set", "formation.rho=0.1,0.2") if command == "sweep" else ()
    done = casswarm(tmp_path, command, "single-agent", option, name, *swept, code=2)
    assert words in done.stderr
    assert "optimizing" not in done.stderr
    assert not (tmp_path / "results").exists()
