"""casswarm reproduce."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import WrongInput, reported_errors
from .options import figure_options, json_option, out_option, quiet_option, seed_option
from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    from ..reproduction import Reproduction


@click.command()
@out_option("Folder for the results.", default=Path("results") / "paper", show_default=True)
@click.option(
    "--runs",
    type=click.IntRange(51),
    default=10_000,
    show_default=True,
    help="Of every policy, in the larger simulation of Table II.",
)
@click.option(
    "--only",
    multiple=True,
    metavar="NAME",
    help="Make this table alone, such as table-2, or the paper's figures: figures; repeatable.",
)
@seed_option
@figure_options
@json_option
@quiet_option
def reproduce(
    out: Path,
    runs: int,
    only: tuple[str, ...],
    seed: int,
    figures: str,
    width: str,
    dpi: int,
    as_json: bool,
    quiet: bool,
) -> None:
    """Make the paper's tables and figures again, and what goes beyond them.

    Takes a few minutes. Prints Tables I and II and what lies beyond, and leaves in the folder a CSV
    for every table, the paper's Figures 1 to 4 and more as pictures, run.json, and README.md, which
    shows them all with captions (not with --only).

    \b
    Examples:
      casswarm reproduce
      casswarm reproduce --out my-folder --format pdf --width column
      casswarm reproduce --only table-2 --only figures --out my-folder
    """
    with reported_errors():
        folder = Folder("reproduce", None, out, figures, width=width, dpi=dpi)
        from .._util.text import did_you_mean
        from ..reproduction import page
        from ..reproduction import reproduce as made_again
        from ..reproduction.reproduce import DRAWN, TABLES

        for name in only:
            if name not in (*TABLES, DRAWN):
                raise WrongInput(
                    f"--only {name!r} is unknown{did_you_mean(name, [*TABLES, DRAWN])}"
                )
        started = time.perf_counter()
        found = made_again(
            runs,
            seed,
            lambda what: say(f"{time.perf_counter() - started:5.0f} s  {what}", quiet),
            only or None,
        )
        for name, table in found.tables.items():
            folder.table(name, table)
        folder.draw(found.figures)
        if found.complete:
            folder.text("README.md", page(found, figures))
        result = {name: table.to_dict("records") for name, table in found.tables.items()}
        content = folder.record(result, {"runs": runs, "only": list(only), "seed": seed})
    click.echo(json_text(content) if as_json else _words(found))
    say(folder.closing(), quiet)


def _words(found: Reproduction) -> str:
    from ..reproduction.report import words
    from ..reproduction.reproduce import TABLES

    return "\n\n".join(
        f"{TABLES[name]}\n\n{aligned(words(found, name))}"
        for name in ("table-1", "table-2", "empty-sets", "beyond")
        if name in found.tables
    )
