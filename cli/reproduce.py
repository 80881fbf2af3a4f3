"""casswarm reproduce."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .._util.text import aligned_table, did_you_mean
from .common import WrongInput, work
from .options import COUNT, OutputOptions, ResultOptions, option, options, out_option, seed_option

if TYPE_CHECKING:
    from ..reproduction import Reproduction


@dataclass(frozen=True)
class _Selection(OutputOptions):
    runs: int = option(
        "Number of runs that sample what exact distributions leave open in Table II.",
        type=COUNT,
        default=2000,
    )
    only: tuple[str, ...] = option(
        "Reproduce only this table, such as table-2, or only the figures: figures. Repeatable.",
        metavar="NAME",
    )
    seed: int = seed_option()


@dataclass(frozen=True)
class ReproduceOptions(ResultOptions, _Selection):
    """Options of the parts to reproduce, and of their output."""

    out: Path | None = out_option("[default: results/reproduce]")


@click.command()
@options
def reproduce(selection: ReproduceOptions) -> None:
    """Reproduce the paper's tables and figures.

    Takes a few minutes. Prints Tables I and II and the results beyond the paper. Writes a CSV file
    for every table, the paper's Figures 1 to 4 and further figures, run.json, and README.md, which
    shows them all with captions (not with --only).

    \b
    Examples:
      casswarm reproduce
      casswarm reproduce --out my-folder --format pdf --width column
      casswarm reproduce --only table-2 --only figures --out my-folder
    """
    if selection.no_figures and "figures" in selection.only:
        raise WrongInput("--only figures and --no-figures: give one of them")
    with work(selection) as job:
        folder = job.open("reproduce")
        from ..reproduction import page
        from ..reproduction import reproduce as run
        from ..reproduction.reproduce import DRAWN, TABLES

        for name in selection.only:
            if name not in (*TABLES, DRAWN):
                hint = did_you_mean(name, [*TABLES, DRAWN])
                raise WrongInput(f"--only {name!r} is unknown{hint}")
        started = time.perf_counter()
        reproduction = run(
            selection.runs,
            selection.seed,
            lambda task: job.say(f"{time.perf_counter() - started:5.0f} s  {task}"),
            selection.only or (tuple(TABLES) if selection.no_figures else None),
        )
        folder.write_tables(**reproduction.tables)
        result = {name: table.to_dict("records") for name, table in reproduction.tables.items()}
        inputs = {"runs": selection.runs, "only": list(selection.only), "seed": selection.seed}
        folder.write_record(result, inputs)
        if not selection.no_figures:
            folder.write_figures(reproduction.figures)
        if reproduction.complete:
            folder.write_file("README.md", page(reproduction, selection.format))
        folder.extend_record()
        job.finish(_text(reproduction))


def _text(reproduction: Reproduction) -> str:
    from ..reproduction.reproduce import TABLES, table_for_people

    texts = []
    for name in ("table-1", "table-2", "empty-sets", "beyond", "readings"):
        if name in reproduction.tables:
            rows = table_for_people(reproduction, name).astype(str).to_dict("records")
            texts.append(f"{TABLES[name]}\n\n{aligned_table(rows)}")
    return "\n\n".join(texts)
