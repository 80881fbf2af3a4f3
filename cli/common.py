"""What the commands share: options, errors, overrides."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
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


RESUME = "; what was done is kept: once there is room, go on with --resume"
"""What helps where a study that keeps its results could not write."""


@contextmanager
def reported_errors(resumes: bool = False) -> Iterator[None]:
    """Turn the library's errors into messages and exit codes; studies may be resumed."""
    from ..errors import CasswarmError, PlanningError, WorkerError

    try:
        yield
    except KeyboardInterrupt as error:
        kept = "; what was done is kept: go on with --resume" if resumes else ""
        raise Failure(f"interrupted{kept}") from error
    except (PlanningError, WorkerError) as error:
        raise Failure(str(error)) from error
    except CasswarmError as error:
        raise WrongInput(str(error)) from error
    except OSError as error:
        if error.filename is None and error.errno is None:
            raise
        raise Failure(f"{error}{RESUME if resumes else ''}") from error


policy_option = click.option(
    "--policy",
    "policies",
    multiple=True,
    metavar="NAME",
    help="naive, constrained, leader, constrained-feedback, leader-feedback, joint, "
    "joint-feedback, with H steps in view leader-ahead-H and constrained-ahead-H (H a number), or "
    "your own as module:function; repeatable. [default: the first three]",
)
"""Which policies a command works on."""

solver_option = click.option(
    "--solver", default="auto", show_default=True, help="Of the formation problems; see solvers."
)
"""What solves the policies' problems."""


def figure_options(command: F) -> F:
    """How figures are drawn, besides ``--format``."""
    for decorate in reversed(
        (
            click.option(
                "--width",
                type=click.Choice(["column", "page", "slide"]),
                default="page",
                show_default=True,
                help="Of the figures: a journal's column (3.5 in), a page (7.16 in) or a slide "
                "(10 in, large letters).",
            ),
            click.option(
                "--dpi",
                type=click.IntRange(30, 1200),
                default=200,
                show_default=True,
                help="Of figures as PNG.",
            ),
        )
    ):
        command = decorate(command)
    return command


def named_policies(names: tuple[str, ...]) -> list[Any]:
    """Policies of these names, of the paper's where there are none.

    ``module:function`` is imported, from the current folder too.
    """
    from ..errors import PolicyError
    from ..policies import as_policy
    from ..study import PAPER_POLICIES

    def found(name: str) -> Any:
        module, colon, attribute = name.partition(":")
        if not colon:
            return name
        if "" not in sys.path and str(Path.cwd()) not in sys.path:
            sys.path.insert(0, str(Path.cwd()))
        try:
            policy = getattr(import_module(module), attribute)
        except (ImportError, AttributeError, ValueError) as error:
            raise PolicyError(f"policy {name!r} cannot be imported: {error}") from error
        return as_policy(policy, attribute)

    return [found(name) for name in names or PAPER_POLICIES]


def study_options(command: F) -> F:
    """Options of the commands that keep their results as they are made, and may share the work."""
    for decorate in reversed(
        (
            click.option(
                "--workers",
                type=click.IntRange(1),
                default=1,
                show_default=True,
                help="Processes that share the work; changes no number.",
            ),
            click.option(
                "--dask",
                metavar="ADDRESS",
                help="Send the work to a Dask cluster, such as tcp://127.0.0.1:8786, instead. "
                "Needs the extra: pip install 'casswarm[dask]'.",
            ),
            click.option(
                "--resume",
                is_flag=True,
                help="Go on with what an interrupted run left in the folder; inputs as before.",
            ),
            click.option(
                "--fresh", is_flag=True, help="Begin anew in a folder with an unfinished study."
            ),
        )
    ):
        command = decorate(command)
    return command


@contextmanager
def executor(workers: int, dask: str | None) -> Iterator[Any]:
    """What `workers` and `--dask` ask for: a number of processes, or an executor of a cluster."""
    if dask is None:
        yield workers
        return
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise WrongInput("--dask needs Dask: pip install 'casswarm[dask]'") from error
    try:
        client = Client(dask, timeout=10, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise Failure(f"no Dask scheduler answers at {dask}: {error}") from error
    with client:
        yield client.get_executor(pure=False, retries=3)


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
