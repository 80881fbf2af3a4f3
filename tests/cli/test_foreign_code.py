"""Files and code of others: nothing is run without consent, names that are no plain text are
escaped or refused, and code that fails is one line with its place.
"""

from __future__ import annotations

import json
import shutil

import pytest
from commands import SMALL_SIMULATION, casswarm, casswarm_program, contents, with_hazard

import casswarm as csw

MODULE = """\
import pathlib

pathlib.Path(__file__).with_name("RAN").touch()


def rate(positions, alive):
    return 0.1 * alive


def stay(step, positions, previous_velocities, alive):
    return 0 * positions
"""
EVIL = 'kind = "evil:rate"'
COMMANDS = [
    ("scenarios", "check", "evil.toml"),
    ("scenarios", "show", "evil.toml"),
    ("scenarios", "new", "copy.toml", "--from", "evil.toml"),
    ("plan", "evil.toml"),
    ("plan-swarm", "evil.toml"),
    ("simulate", "evil.toml"),
    ("evaluate", "evil.toml"),
    ("sweep", "evil.toml", "--set", "formation.rho=0.1"),
    ("explore", "evil.toml", "--no-browser"),
    ("plan", "single-agent", "--set", 'hazard={kind="evil:rate"}'),
    ("plot", "saved"),
    ("animate", "saved"),
]


@pytest.fixture
def mailed(tmp_path, finished):
    """Folder of hostile files: a scenario, its module, modules of known names, results."""
    for name in ("evil", "html", "numpy", "casadi", "casswarm"):
        (tmp_path / f"{name}.py").write_text(MODULE)
    scenario = csw.load_scenario("single-agent").to_toml()
    (tmp_path / "evil.toml").write_text(with_hazard(scenario, EVIL))
    shutil.copytree(finished(*SMALL_SIMULATION, "--no-figures")[0], tmp_path / "saved")
    record = json.loads((tmp_path / "saved" / "run.json").read_text())
    record["scenario"] = with_hazard(record["scenario"], EVIL)
    (tmp_path / "saved" / "run.json").write_text(json.dumps(record))
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: "-".join(command[:2]))
def test_code_that_a_file_names_is_not_run_without_consent(mailed, command):
    before = contents(mailed)
    done = casswarm_program(mailed, *command, code=2)
    assert "evil:rate" in done.stderr
    assert "--allow-code" in done.stderr
    assert contents(mailed) == before
    assert not (mailed / "RAN").exists()


def test_code_is_run_with_consent(mailed):
    done = casswarm_program(mailed, "scenarios", "check", "evil.toml", "--allow-code")
    assert "valid" in done.stdout
    assert (mailed / "RAN").exists()


@pytest.mark.slow
def test_policy_from_the_current_folder_hides_no_other_module(tmp_path):
    (tmp_path / "evil.py").write_text(MODULE)
    (tmp_path / "html.py").write_text("raise SystemExit('not the library')\n")
    options = ("--policy", "evil:stay", "--runs", 2, "--report")
    done = casswarm_program(tmp_path, "simulate", "single-agent", *options)
    assert "stay" in done.stdout
    assert (tmp_path / "RAN").exists()


# --- odd names

ESC, BIDI = "\x1b[2J", "\u202e"


def is_plain(text):
    return all(c.isprintable() or c in "\n\r\t" for c in text)


@pytest.mark.parametrize("name", [ESC, BIDI, "\x07", "$x$"])
def test_file_with_odd_name_is_used_and_its_name_escaped(tmp_path, name):
    path = f"a{name}b.toml"
    text = csw.load_scenario("single-agent").to_toml()
    (tmp_path / path).write_text(text.replace("v_max = ", "v_max = -"))
    done = casswarm(tmp_path, "scenarios", "check", path, code=2)
    assert is_plain(done.stderr)
    assert "swarm.v_max" in done.stderr


@pytest.mark.parametrize(
    "name", ["a\\u001b[2J", "a\\u202eb", "a\\u0000", "a$x_{$", "a/b", "..", ""]
)
def test_scenario_with_odd_name_is_refused(tmp_path, name):
    text = csw.load_scenario("single-agent").to_toml()
    (tmp_path / "odd.toml").write_text(text.replace('name = "single-agent"', f'name = "{name}"'))
    done = casswarm(tmp_path, "plan", "odd.toml", code=2)
    assert "name is" in done.stderr
    assert "printable characters" in done.stderr
    assert is_plain(done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["odd.toml"]


# --- code that fails

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


@pytest.mark.slow
@pytest.mark.parametrize("command", ["simulate", "evaluate"])
@pytest.mark.parametrize("name", FAILING)
def test_failing_policy_is_one_line_with_users_line(folder, command, name):
    options = (command, "single-agent", "--policy", f"mine:{name}", "--quiet")
    done = casswarm(folder, *options, code=1)
    assert done.stderr == f"Error: {FAILING[name]}\n"


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_policy_beyond_its_time_limit_is_one_line(folder, workers):
    options = ("--policy", "mine:endless", "--policy-time-limit", 0.5, "--workers", workers)
    done = casswarm(folder, "simulate", "single-agent", "--runs", 4, "--quiet", *options, code=1)
    assert "policy 'endless' took longer than its time limit of 0.5 s at step 2" in done.stderr
    assert done.stderr.count("\n") == 1
