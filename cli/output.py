"""What commands print: results, progress, and which files were written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.documents import json_text
from .._util.text import printable
from .options import FigureOptions, OutputOptions

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


_BAR = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}"


def aligned(rows: Sequence[tuple[str, ...]]) -> str:
    """Rows as columns of text, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def aligned_table(rows: Sequence[Mapping[Any, str]]) -> str:
    """Records of texts as aligned columns, with their keys as the header."""
    return aligned([tuple(rows[0]), *(tuple(row.values()) for row in rows)])


@contextmanager
def progress_report(quiet: bool) -> Iterator[csw.Progress | None]:
    """Report progress on standard error: with a bar where a total is known, else with a line.

    Yields None where nothing should be reported. Bars are drawn on terminals only.
    """
    if quiet:
        yield None
        return
    from tqdm import tqdm

    bars: dict[str, Any] = {}
    with ExitStack() as stack:

        def report(task: str, done: float, total: float | None) -> None:
            if total is None and not done:
                say(task)
                return
            if task not in bars:
                bars[task] = stack.enter_context(tqdm(desc=task, bar_format=_BAR, disable=None))
            bars[task].total = total
            bars[task].update(done - bars[task].n)

        yield report


def say(text: str, quiet: bool = False) -> None:
    """Print a line on standard error."""
    if not quiet:
        click.echo(printable(text), err=True)


def open_folder(
    command: str, scenario: csw.Scenario | None, out: Path | None, figures: FigureOptions
) -> ResultsFolder:
    """Folder for the results of a command, with figures as the options ask for them."""
    from ..results.folder import FigureFormat, ResultsFolder

    figure_format = FigureFormat(figures.format, figures.width, figures.dpi)
    return ResultsFolder.create(command, scenario, out, figure_format)


def print_result(
    folder: ResultsFolder, content: Mapping[str, Any], text: str, output: OutputOptions
) -> None:
    """Print the result, as text or as JSON, and which files were written."""
    click.echo(json_text(content) if output.as_json else text)
    say(folder.summary(), output.quiet)
