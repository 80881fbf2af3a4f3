"""Files of somebody else: no command runs, deletes or overwrites what they name or contain."""

import hashlib
import json
import re
import shutil

import pytest
from commands import casswarm_program as casswarm

MODULE = """\
import pathlib

pathlib.Path(__file__).with_name("RAN").touch()


def rate(positions, alive):
    return 0.1 * alive


def stay(step, positions, previous_velocities, alive):
    return 0 * positions
"""
HAZARD = '[hazard]\nkind = "evil:rate"\n\n[guide]'
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


def with_hazard(text):
    """Text of a scenario whose rates are a function of its own."""
    return re.sub(r"\[hazard\].*?\[guide\]", HAZARD, text, flags=re.DOTALL)


def contents(folder):
    """Hash of every file below a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Text of a scenario whose rates are a function of its own."""
    shown = casswarm(tmp_path_factory.mktemp("shown"), "scenarios", "show", "single-agent").stdout
    return with_hazard(shown)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Results of a simulation."""
    folder = tmp_path_factory.mktemp("saved")
    casswarm(
        folder, "simulate", "single-agent", "--runs", 5, "--policy", "leader", "--out", "saved"
    )
    return folder / "saved"


@pytest.fixture
def mailed(tmp_path, scenario, saved):
    """Folder of hostile files: a scenario, its module, modules of known names, results."""
    for name in ("evil", "html", "numpy", "casadi", "casswarm"):
        (tmp_path / f"{name}.py").write_text(MODULE)
    (tmp_path / "evil.toml").write_text(scenario)
    shutil.copytree(saved, tmp_path / "saved")
    record = json.loads((tmp_path / "saved" / "run.json").read_text())
    record["scenario"] = with_hazard(record["scenario"])
    (tmp_path / "saved" / "run.json").write_text(json.dumps(record))
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: "-".join(command[:2]))
def test_code_that_a_file_names_is_not_run_without_consent(mailed, command):
    before = contents(mailed)
    done = casswarm(mailed, *command, code=2)
    assert "evil:rate" in done.stderr
    assert "--allow-code" in done.stderr
    assert contents(mailed) == before
    assert not (mailed / "RAN").exists()


def test_code_is_run_with_consent(mailed):
    done = casswarm(mailed, "scenarios", "check", "evil.toml", "--allow-code")
    assert "valid" in done.stdout
    assert (mailed / "RAN").exists()


@pytest.mark.slow
def test_policy_from_the_current_folder_hides_no_other_module(tmp_path):
    (tmp_path / "evil.py").write_text(MODULE)
    (tmp_path / "html.py").write_text("raise SystemExit('not the library')\n")
    options = ("--policy", "evil:stay", "--runs", 2, "--report")
    done = casswarm(tmp_path, "simulate", "single-agent", *options)
    assert "stay" in done.stdout
    assert (tmp_path / "RAN").exists()
