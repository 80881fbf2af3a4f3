"""Every command as a user runs it: help, wrong input, exit codes."""

import subprocess
import sys

import pytest
from click.testing import CliRunner
from commands import casswarm

from casswarm import __version__
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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_version_option_prints_installed_version(tmp_path):
    assert __version__ in casswarm(tmp_path, "--version").stdout


def test_unwritable_folder_fails_with_exit_code_1(tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = casswarm(tmp_path, "plan", "paper-1", "--out", "file/results", code=1)
    assert "cannot write" in done.stderr
