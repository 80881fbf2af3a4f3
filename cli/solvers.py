"""casswarm solvers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from .._util.documents import json_text
from .output import aligned_table, wrapped

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
