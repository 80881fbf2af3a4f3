"""casswarm solvers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from .._util.documents import json_text
from .output import aligned


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def solvers(as_json: bool) -> None:
    """List the solvers and their capabilities.

    The names are those that --solver accepts. Solvers that this installation lacks and solvers that
    are not supported are listed with the reasons.
    """
    from ..optimization.solvers import UNSUPPORTED

    listed = _solvers()
    if as_json:
        click.echo(json_text({"solvers": listed, "unsupported": UNSUPPORTED}))
        return
    header = ("solver", "problems", "batch", "multipliers", "time limit")
    table = aligned([header, *map(_row, listed)]).splitlines()
    summaries = ["description", *(row["summary"] for row in listed)]
    click.echo("\n".join(f"{line}  {text}" for line, text in zip(table, summaries, strict=True)))
    missing = [(row["name"], row["unavailable"]) for row in listed if row["unavailable"]]
    if missing:
        click.echo("\nNot available in this installation:\n" + _reasons(missing))
    click.echo("\nNot supported:\n" + _reasons(list(UNSUPPORTED.items())))


def _solvers() -> list[dict[str, Any]]:
    from ..optimization.solvers import SOLVERS

    return [
        {
            "name": name,
            "summary": solver.summary,
            **asdict(solver.capabilities),
            "unavailable": solver.unavailable(),
        }
        for name, solver in SOLVERS.items()
    ]


def _row(solver: dict[str, Any]) -> tuple[str, ...]:
    marks = ("yes" if solver[name] else "-" for name in ("batch", "multipliers", "time_limit"))
    return (solver["name"], solver["problems"], *marks)


def _reasons(pairs: list[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in pairs)
    return "\n".join(f"{name:{width}s}  {reason}" for name, reason in pairs)
