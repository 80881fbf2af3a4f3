"""What the commands share: options, errors, overrides."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from ..scenario import Scenario

F = TypeVar("F", bound=Callable[..., Any])


class Failure(click.ClickException):
    """The input was fine, the work failed: exit code 1."""

    exit_code = 1


class WrongInput(click.ClickException):
    """The input is wrong: exit code 2."""

    exit_code = 2


@contextmanager
def reported_errors() -> Iterator[None]:
    """Turn the library's errors into messages and exit codes."""
    from ..errors import CasswarmError, PlanningError

    try:
        yield
    except PlanningError as error:
        raise Failure(str(error)) from error
    except CasswarmError as error:
        raise WrongInput(str(error)) from error


policy_option = click.option(
    "--policy",
    "policies",
    multiple=True,
    metavar="NAME",
    help="naive, constrained or leader; repeatable. [default: all three]",
)
"""Which of the built-in policies a command works on."""


def scenario_options(command: F) -> F:
    """SCENARIO, and the options that every command on a scenario takes."""
    for decorate in reversed(
        (
            click.argument("scenario"),
            click.option(
                "--set",
                "settings",
                multiple=True,
                metavar="KEY=VALUE",
                help="Change a value of the scenario, for example --set formation.rho=0.1; "
                "the value is written as in the file. Repeatable.",
            ),
            click.option(
                "--out",
                type=click.Path(file_okay=False, path_type=Path),
                help="Folder for the results. [default: results/COMMAND-NAME]",
            ),
            click.option(
                "--format",
                "figures",
                type=click.Choice(["png", "pdf", "svg"]),
                default="png",
                show_default=True,
                help="Of the figures.",
            ),
            click.option("--json", "as_json", is_flag=True, help="Print the result as JSON."),
            click.option("--quiet", is_flag=True, help="No progress."),
        )
    ):
        command = decorate(command)
    return command


def load(source: str, settings: tuple[str, ...], **overrides: Any) -> Scenario:
    """The scenario of a name or path, with ``--set`` and the command's own overrides.

    `overrides` are dotted keys with ``__`` for the dot; None leaves the scenario's value.
    """
    from ..scenario import load_scenario

    values = dict(map(_setting, settings))
    values |= {
        key.replace("__", "."): value for key, value in overrides.items() if value is not None
    }
    scenario = load_scenario(source)
    return scenario.with_values(values) if values else scenario


def _setting(text: str) -> tuple[str, object]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise WrongInput(f"--set {text!r} is not of the form KEY=VALUE, such as formation.rho=0.1")
    try:
        return key.strip(), tomllib.loads(f"value = {value.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()  # a bare word, such as global
