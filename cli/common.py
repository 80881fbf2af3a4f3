"""What the commands share: errors, scenarios with overrides, policies by name, executors."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ..scenario import Scenario


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


def named_policies(names: tuple[str, ...]) -> list[Any]:
    """Policies of these names, of the paper's where there are none.

    ``module:function`` is imported, from the current folder too.
    """
    from ..errors import PolicyError
    from ..policies import as_policy
    from ..studies.simulation import PAPER_POLICIES

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
