"""Texts of messages: suggestions, and characters that a terminal would obey."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any


def closest(word: str, known: Iterable[str]) -> str | None:
    """The known word that an unknown one most resembles, or None."""
    return next(iter(get_close_matches(word, list(known), 1)), None)


def suggestion(word: str, known: Iterable[str]) -> str:
    """End of a message about an unknown word: the closest known word, if any."""
    close = closest(word, known)
    return f"; did you mean {close!r}?" if close else ""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """End of a message about an unknown word: the closest known word, and all known words."""
    words = list(known)
    return f"{suggestion(word, words)} (known: {', '.join(words)})"


def counted(count: float, noun: str, plural: str = "") -> str:
    """Number and noun, in the plural unless the number is one; four digits of a fraction."""
    number = f"{count:.4g}" if isinstance(count, float) else f"{count}"
    return f"{number} {noun if count == 1 else plural or f'{noun}s'}"


def shown(value: Any) -> str:
    """`repr` of a value that a user gave; a NumPy scalar or 0-d array as the number it holds."""
    scalar = getattr(value, "shape", None) == () and hasattr(value, "item")
    return quoted(value.item() if scalar else value, 300)


def printable(text: str) -> str:
    """Text in which control and bidirectional characters are written as escapes, but line breaks.

    Messages name files and values of somebody else, which could otherwise move the cursor, hide
    what was printed, or turn around the order of what is read.
    """
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def shortened(text: str, length: int = 60) -> str:
    """Text of somebody else, cut to a length at which a message remains readable."""
    return text if len(text) <= length else f"{text[: length - 3]}..."


def quoted(value: object, length: int = 60) -> str:
    """Representation of a value of somebody else, cut to a length."""
    return shortened(repr(value), length)


WIDTH = 80
"""Number of characters in a line of printed text; only a longer word exceeds it."""


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
