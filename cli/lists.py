"""casswarm scenarios and casswarm solvers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

import casswarm as csw

from .._util.documents import json_text
from .._util.text import aligned, aligned_table, counted, wrapped
from .common import WrongInput, reported_errors
from .options import allow_code_option, complete_scenario, options


@dataclass(frozen=True)
class Consent:
    """Consent to run what a scenario names."""

    allow_code: bool = allow_code_option()


@click.group()
def scenarios() -> None:
    """List, show, create and check scenario files."""


@scenarios.command("list")
def list_() -> None:
    """List the built-in scenarios."""
    for name, description in csw.builtin_scenarios().items():
        click.echo(wrapped(f"{name:14s} {description}", indent=15))


@scenarios.command()
@click.argument("scenario", shell_complete=complete_scenario)
@options
def show(scenario: str, consent: Consent) -> None:
    """Print SCENARIO as a TOML file."""
    with reported_errors():
        click.echo(csw.load_scenario(scenario, allow_code=consent.allow_code).to_toml(), nl=False)


@scenarios.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--from",
    "source",
    default="paper-1",
    show_default=True,
    shell_complete=complete_scenario,
    help="Scenario to copy.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
@options
def new(path: Path, source: str, force: bool, consent: Consent) -> None:
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
        copied = csw.load_scenario(source, allow_code=consent.allow_code).with_values(values)
        csw.save_scenario(copied, path, comments=True)
    click.echo(f"wrote {path}; edit it, then: casswarm scenarios check {path}")


@scenarios.command()
@click.argument(
    "sources", nargs=-1, required=True, metavar="SCENARIO...", shell_complete=complete_scenario
)
@options
def check(sources: tuple[str, ...], consent: Consent) -> None:
    """Check every SCENARIO, and print its size.

    Code that a file names is only run with --allow-code; without it, such a file does not pass.
    """
    from ..scenario.cases import radars_text

    valid, wrong = [], []
    for source in sources:
        try:
            scenario = csw.load_scenario(source, allow_code=consent.allow_code)
        except csw.ScenarioError as error:
            wrong.append(str(error))
            continue
        members, steps = counted(scenario.n, "member"), counted(scenario.n_steps, "step")
        table = scenario.hazard_table
        valid.append((source, "valid", members, radars_text(table), steps, str(table.kind)))
    if valid:
        click.echo(aligned(valid))
    if wrong:
        raise WrongInput("\n".join(wrong))


_MARKS = ("batch", "multipliers", "time_limit")  # capabilities shown as yes or -


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def solvers(as_json: bool) -> None:
    """List the solvers and their capabilities.

    The names are those that --solver accepts. Solvers that this installation lacks and solvers that
    are not supported are listed with the reasons.
    """
    from ..solvers import SOLVERS, UNSUPPORTED

    listed: list[dict[str, Any]] = [
        {
            "name": name,
            "summary": solver.summary,
            **asdict(solver.capabilities),
            "unavailable": solver.unavailable(),
        }
        for name, solver in SOLVERS.items()
    ]
    if as_json:
        click.echo(json_text({"solvers": listed, "unsupported": UNSUPPORTED}))
        return
    rows = [
        {"solver": row["name"], "problems": row["problems"]}
        | {mark.replace("_", " "): "yes" if row[mark] else "-" for mark in _MARKS}
        for row in listed
    ]
    click.echo(aligned_table(rows))
    click.echo("\n" + _described([(row["name"], row["summary"]) for row in listed]))
    missing = [(row["name"], row["unavailable"]) for row in listed if row["unavailable"]]
    if missing:
        click.echo("\nNot available in this installation:\n" + _described(missing))
    click.echo("\nNot supported:\n" + _described(list(UNSUPPORTED.items())))


def _described(pairs: list[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in pairs)
    lines = (f"{name:{width}s}  {description}" for name, description in pairs)
    return wrapped("\n".join(lines), indent=width + 2)
