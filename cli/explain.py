"""casswarm explain."""

from __future__ import annotations

from pathlib import Path

import click

import casswarm as csw

from .._util.text import printable
from .common import Failure, reported_errors


@click.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of further starts."
)
def explain(file: Path, seed: int) -> None:
    """Explain why the program in FILE, in AMPL's .nl format, is infeasible.

    Prints a smallest set of constraints and bounds that contradict each other, or a feasible point.
    Names are those of FILE.row and FILE.col (with these endings instead of .nl), or c0, c1, ... and
    x0, x1, ... The exit code is 1 if the program is infeasible, or if neither could be verified.

    \b
    Examples:
      casswarm explain model.nl
    """
    with reported_errors():
        found = csw.explain(csw.Problem.from_nl(file), seed=seed)
    if not found.feasible:
        raise Failure(str(found))
    click.echo(printable(str(found)))
