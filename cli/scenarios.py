"""casswarm scenarios."""

from __future__ import annotations

from pathlib import Path

import click

import casswarm as csw

from .common import WrongInput, reported_errors
from .output import aligned


@click.group()
def scenarios() -> None:
    """List, show, create and check scenario files."""


@scenarios.command("list")
def list_() -> None:
    """List the built-in scenarios."""
    for name, description in csw.builtin_scenarios().items():
        click.echo(f"{name:14s} {description}")


@scenarios.command()
@click.argument("scenario")
def show(scenario: str) -> None:
    """Print SCENARIO as a TOML file."""
    with reported_errors():
        click.echo(csw.load_scenario(scenario).to_toml(), nl=False)


@scenarios.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--from", "source", default="paper-1", show_default=True, help="Scenario to copy.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def new(path: Path, source: str, force: bool) -> None:
    """Write a scenario file to edit.

    Comments in the file explain every key.

    \b
    Examples:
      casswarm scenarios new mine.toml --from wall
      casswarm scenarios check mine.toml
      casswarm simulate mine.toml
    """
    if path.exists() and not force:
        raise WrongInput(f"{path} exists; choose another name, or overwrite it with --force")
    with reported_errors():
        values = {"name": path.stem, "description": f"copied from {source}"}
        csw.save_scenario(csw.load_scenario(source).with_values(values), path, comments=True)
    click.echo(f"wrote {path}; edit it, then: casswarm scenarios check {path}")


@scenarios.command()
@click.argument("sources", nargs=-1, required=True, metavar="SCENARIO...")
def check(sources: tuple[str, ...]) -> None:
    """Check every SCENARIO, and print its size."""
    valid, wrong = [], []
    for source in sources:
        try:
            scenario = csw.load_scenario(source)
        except csw.ScenarioError as error:
            wrong.append(str(error))
            continue
        radars = len(scenario.hazard.radar_positions)
        size = (f"{scenario.n} members", f"{radars} radars", f"{scenario.n_steps} steps")
        valid.append((source, "valid", *size, str(scenario.hazard_table.kind)))
    if valid:
        click.echo(aligned(valid))
    if wrong:
        raise WrongInput("\n".join(wrong))
