"""Completion of values in the shell."""

import os
import subprocess

import pytest
from commands import CASSWARM

import casswarm as csw


def completed(folder, *words):
    """What bash offers for the last of the words of a command."""
    done = subprocess.run(
        [CASSWARM],
        cwd=folder,
        env=os.environ
        | {
            "_CASSWARM_COMPLETE": "bash_complete",
            "COMP_WORDS": " ".join(("casswarm", *words)),
            "COMP_CWORD": str(len(words)),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return [line.partition(",")[::2] for line in done.stdout.splitlines()]


@pytest.mark.parametrize("command", ["plan", "simulate", "evaluate", "sweep", "plan-swarm"])
def test_scenarios_are_completed_by_name_or_file(tmp_path, command):
    offered = completed(tmp_path, command, "p")
    names = [name for name in csw.builtin_scenarios() if name.startswith("p")]
    assert offered == [*(("plain", name) for name in names), ("file", "p")]


def test_policies_and_solvers_are_completed(tmp_path):
    offered = completed(tmp_path, "simulate", "paper-1", "--policy", "joint")
    assert offered == [("plain", "joint"), ("plain", "joint-replanning")]
    for command in ("simulate", "plan", "compare"):
        assert ("plain", "ipopt") in completed(tmp_path, command, "--solver", "i")


def test_results_folders_are_completed(tmp_path):
    for name, content in (("simulate-a", "run.json"), ("other", "notes.txt")):
        (tmp_path / "results" / name).mkdir(parents=True)
        (tmp_path / "results" / name / content).touch()
    assert completed(tmp_path, "plot", "res") == [("plain", "results/simulate-a"), ("dir", "res")]
