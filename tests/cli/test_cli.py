"""Every command as a user runs it: help, completion in the shell, exit codes."""

import os
import subprocess

import pytest
from click.testing import CliRunner
from commands import CASSWARM, casswarm, python

import casswarm as csw
from casswarm.cli import main

COMMANDS = sorted(main.commands)
SUBCOMMANDS = [("scenarios", name) for name in main.commands["scenarios"].commands]


def invoked(*arguments):
    """Outcome of a command in this process."""
    return CliRunner().invoke(main, list(arguments))


def test_main_help_lists_every_command(tmp_path):
    text = casswarm(tmp_path, "--help").stdout
    assert "casswarm plan paper-1" in text
    for command in COMMANDS:
        assert f"  {command} " in text
    assert "casswarm compare --family quick" in invoked("compare", "--help").output
    text = " ".join(invoked("plan", "--help").output.split())
    assert "--solver TEXT Solver of the guide problem; casswarm solvers lists them." in text


@pytest.mark.parametrize("command", [(name,) for name in COMMANDS] + SUBCOMMANDS, ids=" ".join)
def test_command_help_has_usage_and_plain_text(command):
    outcome = invoked(*command, "--help")
    assert outcome.exit_code == 0
    assert f"Usage: main {' '.join(command)}" in outcome.output
    assert "\\b" not in outcome.output


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"scenarios", "solvers"}))
def test_command_help_shows_examples(command):
    assert f"    casswarm {command}" in invoked(command, "--help").output


@pytest.mark.parametrize("command", [(name,) for name in COMMANDS] + SUBCOMMANDS, ids=" ".join)
def test_option_help_is_a_sentence(command):
    group = main
    for name in command:
        group = group.commands[name]
    for option in group.params:
        if option.param_type_name == "option":
            text = option.help.partition(" [default")[0]
            assert text[0].isupper(), option.name
            assert text.endswith("."), option.name


def test_help_imports_no_numerical_library():
    code = (
        "import sys\n"
        "from casswarm.cli import main\n"
        "for name in main.commands:\n"
        "    main([name, '--help'], standalone_mode=False)\n"
        "sys.exit(bool({'casadi', 'numba', 'pandas', 'matplotlib', 'scipy'} & set(sys.modules)))\n"
    )
    python("-c", code)


def test_version_option_prints_installed_version(tmp_path):
    assert csw.__version__ in casswarm(tmp_path, "--version").stdout


def test_unwritable_folder_fails_with_exit_code_1(tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = casswarm(tmp_path, "plan", "paper-1", "--out", "file/results", code=1)
    assert "cannot write" in done.stderr


# --- completion


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


@pytest.mark.slow
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
