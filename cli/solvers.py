"""casswarm solvers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from .output import aligned, json_text


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def solvers(as_json: bool) -> None:
    """List the solvers that --solver takes and what each can do.

    Says of every other solver why it cannot be used here, or why it is left out.
    """
    from ..optimization.solvers import UNSUPPORTED

    known = _known()
    if as_json:
        click.echo(json_text({"solvers": known, "left_out": UNSUPPORTED}))
        return
    head = ("solver", "problems", "batch", "multipliers", "time limit")
    table = aligned([head, *map(_row, known)]).splitlines()
    told = ["what it is", *(row["summary"] for row in known)]
    click.echo("\n".join(f"{line}  {what}" for line, what in zip(table, told, strict=True)))
    missing = [(row["name"], row["unavailable"]) for row in known if row["unavailable"]]
    if missing:
        click.echo("\nNot usable in this installation:\n" + _reasons(missing))
    click.echo("\nLeft out:\n" + _reasons(list(UNSUPPORTED.items())))


def _known() -> list[dict[str, Any]]:
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
