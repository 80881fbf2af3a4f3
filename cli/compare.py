"""casswarm compare."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import Failure, reported_errors
from .options import figure_options, json_option, out_option, quiet_option
from .output import Folder, aligned, json_text, say

if TYPE_CHECKING:
    import pandas as pd

    from ..comparison import Comparison
    from ..comparison.run import Progress


@click.command()
@click.option(
    "--family",
    "families",
    multiple=True,
    metavar="NAME",
    help="guides, formations, or quick for a first look; repeatable. "
    "[default: guides and formations]",
)
@click.option(
    "--solver",
    "solvers",
    multiple=True,
    metavar="NAME",
    help="Repeatable; see casswarm solvers. [default: all]",
)
@click.option(
    "--problems",
    type=click.IntRange(1),
    help="How many of every kind in a family. [default: guides 3, formations 3, quick 1]",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Same seed, same problems."
)
@click.option(
    "--time-limit",
    "seconds",
    type=click.FloatRange(0, min_open=True),
    default=2.0,
    show_default=True,
    help="Seconds for building and solving a problem once; a solver that takes longer is ended.",
)
@out_option("Folder for the results. [default: results/compare]")
@figure_options
@json_option
@quiet_option
def compare(
    families: tuple[str, ...],
    solvers: tuple[str, ...],
    problems: int | None,
    seed: int,
    seconds: float,
    out: Path | None,
    figures: str,
    width: str,
    dpi: int,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compare solvers on problems from real runs: what they solve, how fast, and how truly.

    Each solver runs in a process of its own: one that crashes or hangs is a row of the tables. All
    answers are judged by residuals recomputed from the problem. Prints a summary and writes
    report.html and report.md, the tables cells.csv (a row a problem, start and solver),
    summary.csv, problems.csv and failures.csv, profiles as figures (in report.html always PNG), and
    run.json.

    Finished cells are kept: stopped and started again with the same options, it goes on where it
    was. The default takes five to ten minutes.

    \b
    Examples:
      casswarm compare --family quick
      casswarm compare
      casswarm compare --family formations --solver spectral --solver ipopt --problems 10
    """
    with reported_errors(), ExitStack() as stack:
        from ..comparison import DEFAULT
        from ..comparison import compare as run

        folder = Folder("compare", None, out, figures, width=width, dpi=dpi)
        try:
            comparison = run(
                families or DEFAULT,
                solvers or None,
                problems=problems,
                seed=seed,
                seconds=seconds,
                folder=folder.path,
                progress=None if quiet else _bar(stack),
            )
        except KeyboardInterrupt:
            raise Failure(
                f"stopped; finished cells are kept in {folder.path}: the same command goes on"
            ) from None
    content = _write(folder, comparison)
    click.echo(json_text(content) if as_json else summary_text(comparison.summary))
    say(folder.closing(), quiet)


def _bar(stack: ExitStack) -> Progress:
    """A progress bar on standard error, nothing where that is no terminal."""
    from tqdm import tqdm

    bar = stack.enter_context(tqdm(desc="making problems", unit="cell", disable=None))

    def tell(done: int, total: int, what: str) -> None:
        if total and bar.total != total:
            bar.reset(total)
            bar.initial = done
            bar.set_description("comparing")
        bar.set_postfix_str(what, refresh=False)
        bar.update(done - bar.n)

    return tell


def _write(folder: Folder, comparison: Comparison) -> dict[str, Any]:
    from ..comparison.journal import CELLS, INPUTS
    from ..comparison.report import make_report
    from ..figures import theme

    with theme(folder.width):
        report = make_report(comparison)
    for name, table in report.tables.items():
        folder.table(name, table)
    for name, figure in report.figures.items():
        folder.figure(name, figure)
    folder.text("report.md", report.markdown(folder.ending))
    drawn = report.figures if folder.ending == "png" else ()  # not to draw them twice
    images = {name: (folder.path / f"{name}.png").read_bytes() for name in drawn}
    folder.text("report.html", report.html(images))
    folder.files += [INPUTS, CELLS]
    result = {
        "summary": comparison.summary.to_dict("records"),
        "failures": report.tables["failures"].to_dict("records"),
    }
    return folder.record(result, comparison.inputs)


def summary_text(summary: pd.DataFrame) -> str:
    """The summary for a terminal: a table a family and start."""
    head = ("solver", "solved", "best known", "said, not true", "mean ms", "build ms", "iterations")
    texts = []
    for (family, start), part in summary.groupby(["family", "start"], sort=False):
        rows = [
            (
                str(row["solver"]),
                f"{100 * row['solved']:.0f} %",
                f"{100 * row['found']:.0f} %",
                f"{row['said_not_true']}",
                f"{row['mean_ms']:.3g}",
                f"{row['build_ms']:.3g}",
                f"{row['iterations']:g}",
            )
            for row in part.to_dict("records")
        ]
        problems = int(part["problems"].iloc[0])
        texts.append(f"{family}, {start} start, {problems} problems\n{aligned([head, *rows])}")
    return "\n\n".join(texts)
