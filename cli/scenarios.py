"""casswarm scenarios."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

import casswarm as csw

from .._util.text import counted
from . import completion
from .common import WrongInput, reported_errors
from .options import Command, allow_code_option
from .output import aligned, wrapped

ALLOW_CODE: Callable[[Command], Command] = allow_code_option().metadata["declare"]("allow_code")


@click.group()
def scenarios() -> None:
    """List, show, create and check scenario files."""


@scenarios.command("list")
def list_() -> None:
    """List the built-in scenarios."""
    for name, description in csw.builtin_scenarios().items():
        click.echo(wrapped(f"{name:14s} {description}", indent=15))


@scenarios.command()
@click.argument("scenario", shell_complete=completion.scenarios)
@ALLOW_CODE
def show(scenario: str, allow_code: bool) -> None:
    """Print SCENARIO as a TOML file."""
    with reported_errors():
        click.echo(csw.load_scenario(scenario, allow_code=allow_code).to_toml(), nl=False)


@scenarios.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--from",
    "source",
    default="paper-1",
    show_default=True,
    shell_complete=completion.scenarios,
    help="Scenario to copy.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
@ALLOW_CODE
def new(path: Path, source: str, force: bool, allow_code: bool) -> None:
    """Write a scenario file to edit.

    Comments in the file explain every key, and show those that may be added.

    \b
    Examples:
      casswarm scenarios new mine.toml --from wall
      casswarm scenarios check mine.toml
      casswarm simulate mine.toml
    """
    with reported_errors():
        if path.exists() and not force:
            raise WrongInput(f"{path} exists; choose another name, or overwrite it with --force")
        values = {"name": path.stem, "description": f"copied from {source}"}
        copied = csw.load_scenario(source, allow_code=allow_code).with_values(values)
        csw.save_scenario(copied, path, comments=True)
    click.echo(f"wrote {path}; edit it, then: casswarm scenarios check {path}")


@scenarios.command()
@click.argument(
    "sources", nargs=-1, required=True, metavar="SCENARIO...", shell_complete=completion.scenarios
)
@ALLOW_CODE
def check(sources: tuple[str, ...], allow_code: bool) -> None:
    """Check every SCENARIO, and print its size.

    Code that a file names is only run with --allow-code; without it, such a file does not pass.
    """
    valid, wrong = [], []
    for source in sources:
        try:
            scenario = csw.load_scenario(source, allow_code=allow_code)
        except csw.ScenarioError as error:
            wrong.append(str(error))
            continue
        radars = len(scenario.hazard.radar_positions)
        numbers = {"member": scenario.n, "radar": radars, "step": scenario.n_steps}
        size = tuple(counted(number, noun) for noun, number in numbers.items())
        valid.append((source, "valid", *size, str(scenario.hazard_table.kind)))
    if valid:
        click.echo(aligned(valid))
    if wrong:
        raise WrongInput("\n".join(wrong))
