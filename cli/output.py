"""What commands print: results, and which files were written."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import casswarm as csw

from .._util.documents import json_text
from .._util.text import printable
from .options import FigureOptions, OutputOptions

if TYPE_CHECKING:
    from ..results.folder import ResultsFolder


WIDTH = 80
"""Number of characters in a line of what commands print; only a longer word exceeds it."""


def aligned(rows: Sequence[tuple[str, ...]], labels: int = 1) -> str:
    """Rows as columns of text, the first to the left and the others to the right.

    Columns that do not fit in `WIDTH` are in further tables below, after the first `labels` columns
    again.
    """
    columns: list[list[str]] = []
    for cells in zip(*rows, strict=True):
        width = max(map(len, cells))
        columns.append([cell.rjust(width) if columns else cell.ljust(width) for cell in cells])
    tables = [columns[:labels]]
    for column in columns[labels:]:
        wider = [*tables[-1], column]
        if len(tables[-1]) > labels and len("  ".join(cells[0] for cells in wider)) > WIDTH:
            tables.append(wider := [*columns[:labels], column])
        tables[-1] = wider
    return "\n\n".join(
        "\n".join("  ".join(row).rstrip() for row in zip(*table, strict=True)) for table in tables
    )


def aligned_table(rows: Sequence[Mapping[Any, str]]) -> str:
    """Records of texts as aligned columns, with their keys as the header."""
    return aligned([tuple(rows[0]), *(tuple(row.values()) for row in rows)])


def wrapped(text: str, indent: int = 2) -> str:
    """Text whose lines are at most `WIDTH` long; what continues a line is indented."""
    fit = textwrap.TextWrapper(
        WIDTH, subsequent_indent=indent * " ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(fit.fill(line) if len(line) > WIDTH else line for line in text.split("\n"))


def say(text: str, quiet: bool = False) -> None:
    """Print a line on standard error."""
    if not quiet:
        click.echo(printable(text), err=True)


def open_folder(
    command: str, scenario: csw.Scenario | None, out: Path | None, figures: FigureOptions
) -> ResultsFolder:
    """Folder for the results of a command, with figures as the options ask for them."""
    from ..results.drawing import FigureFormat
    from ..results.folder import ResultsFolder

    figure_format = FigureFormat(figures.format, figures.width, figures.dpi)
    return ResultsFolder.create(command, scenario, out, figure_format)


def print_result(
    folder: ResultsFolder, content: Mapping[str, Any], text: str, output: OutputOptions
) -> None:
    """Print the result, as text or as JSON, and which files were written."""
    click.echo(json_text(content) if output.as_json else wrapped(text))
    say(folder.summary(), output.quiet)
