"""casswarm evaluate says what it will need, and keeps to a limit of memory."""

import json
import re

import pytest
from commands import casswarm

GAUNTLET = ("evaluate", "gauntlet", "--policy", "leader", "--no-figures")


@pytest.mark.slow
def test_states_and_memory_are_predicted_before_the_work(tmp_path):
    arguments = "evaluate", "paper-1", "--policy", "leader", "--no-figures"
    done = casswarm(tmp_path, *arguments)
    (expected,) = re.findall(r"^about ([\d,]+) states, (?:less than )?\d+ MB$", done.stderr, re.M)
    assert 500 < int(expected.replace(",", "")) < 10_000  # samples are smaller where time is short
    quiet = casswarm(tmp_path, *arguments, "--quiet")
    assert "about" not in quiet.stderr
    assert quiet.stdout == done.stdout


def test_memory_that_does_not_suffice_widens_the_bounds(tmp_path):
    done = casswarm(tmp_path, *GAUNTLET, "--memory", 1)
    assert "states, 1 MB; limits come before the tolerance\n" in done.stderr
    assert "or memory (--memory, memory=)" in " ".join(done.stdout.split())
    (record,) = tmp_path.rglob("run.json")
    inputs = json.loads(record.read_text())["inputs"]
    assert inputs["memory"] == 1


def test_estimates_are_not_predicted(tmp_path):
    done = casswarm(tmp_path, *GAUNTLET, "--runs", 20)
    assert "about" not in done.stderr


def test_impossible_memory_is_one_line(tmp_path):
    done = casswarm(tmp_path, *GAUNTLET, "--memory", 0.5, code=2)
    assert "--memory" in done.stderr
