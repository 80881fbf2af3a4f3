"""casswarm solvers."""

from __future__ import annotations

import click


@click.command()
def solvers() -> None:
    """The solvers that --solver takes, and what each can do."""
    from ..solvers import SOLVERS

    for name, solver in SOLVERS.items():
        click.echo(f"{name:20s} {solver.summary}")
