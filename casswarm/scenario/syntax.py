"""Syntax errors of scenario files: the line, a caret where it ends to make sense, and a hint."""

from __future__ import annotations

import re
from tomllib import TOMLDecodeError

_PLACE = re.compile(r"\(at line (\d+), column (\d+)\)")
_MAX_LINE = 72  # characters of a line that are quoted
_STATEMENT = re.compile(r"\s*(\[{1,2}[^\[\],]+\]{1,2}\s*(#.*)?$|[\w.\"'-]+\s*=)")
_ARRAY = re.compile(r"\s*([\w.\"'-]+)\s*=\s*\[")

_HINTS = (
    ("Invalid value", r"\0(true|yes|on)\b", "write true, in lower case and without quotes"),
    ("Invalid value", r"\0(false|no|off)\b", "write false, in lower case and without quotes"),
    ("Invalid value", r"\0(none|null|nil)\b", "omit the key instead"),
    ("Invalid value", r"\0[“”„‘’]", 'a text needs straight quotes, such as "ring"'),
    ("Invalid value", r"\0([^\W\d][\w +-]*)", 'a text needs quotes: "{1}"'),
    ("Invalid value", r"\0(\.\d+)", "a number needs a digit before its point: 0{1}"),
    ("Invalid value", r"\0\(", "a list is written in square brackets"),
    ("Invalid value", r"\0,", "there is a comma too many"),
    ("Invalid value", r"=\s*\0$", "the key has no value"),
    ("Expected newline", r"(\d+)\0,(\d+)", "a number has a decimal point: {1}.{2}"),
    ("Expected newline", r"(\d+)\0\.(?!\d)", "a number needs a digit after its point: {1}.0"),
    ("Expected newline", r"\0\]", "there is a ']' too many"),
    ("Expected newline", r"[^\d.]0\0\d", "a number has no zeros in front"),
    ("Expected newline", r"\d\s*\0[^\s\d]", "a number stands alone: no units, no calculations"),
    ("Expected newline", "", "one KEY = VALUE a line; comments start with '#'"),
    ("Expected '='", "", "write KEY = VALUE, or [TABLE] in brackets"),
    ("Expected ']'", "", "a ']' must end the name of the table"),
    ("Unclosed inline table", "", "a '}}' is missing"),
    (r"Illegal character '\\n'|Unterminated|Expected [\"']", "", "a quote is missing"),
    ("Cannot (overwrite|declare)", "", "a key or table may occur only once"),
    ("Invalid hex|Unescaped", "", r"a backslash in a text is written \\, or use single quotes"),
    ("Invalid statement", "", "one KEY = VALUE a line; comments start with '#'"),
)
"""Pattern of tomllib's message, pattern of the line, where the error is a null character, hint."""


def syntax_message(text: str, error: TOMLDecodeError) -> str:
    """Message about a syntax error: tomllib's, the line with a caret, and a hint where known.

    Parameters
    ----------
    text : str
        Of the file.
    error : TOMLDecodeError
    """
    lines = text.replace("\r\n", "\n").split("\n")
    if place := _PLACE.search(str(error)):
        row, column = int(place[1]) - 1, int(place[2]) - 1
    else:  # at the end
        row = max((k for k, line in enumerate(lines) if line.strip()), default=0)
        column = len(lines[row].rstrip())
    parts = [str(error), *_quoted(lines[row], column)]
    if hint := _array_hint(lines, row, column, str(error)) or _hint(lines[row], column, str(error)):
        parts.append(f"hint: {hint}")
    return "\n  ".join(parts)


def _quoted(line: str, column: int) -> tuple[str, str]:
    """The line, or the part of a long one about the column, and a caret below the column."""
    start = max(0, min(column - _MAX_LINE // 2, len(line) - _MAX_LINE))
    shown = line.replace("\t", " ")[start : start + _MAX_LINE]
    return f"  {shown.rstrip()}", f"  {' ' * (column - start)}^"


def _hint(line: str, column: int, message: str) -> str | None:
    marked = f"{line[max(0, column - _MAX_LINE) : column]}\0{line[column : column + _MAX_LINE]}"
    for kind, pattern, hint in _HINTS:
        if re.match(kind, message) and (found := re.search(pattern, marked, re.IGNORECASE)):
            return hint.format(found[0], *map(str.strip, found.groups("")))
    return None


def _array_hint(lines: list[str], row: int, column: int, message: str) -> str | None:
    """Hint about an array that does not end: where it starts, or that a comma is missing."""
    begun = [k for k in range(row + 1) if _ARRAY.match(lines[k])]
    at_end = message.startswith("Invalid value (at end") and not lines[row].rstrip().endswith("=")
    if not begun or not (at_end or message.startswith("Unclosed array")):
        return None
    if not at_end and lines[row][column:].strip() and not _STATEMENT.match(lines[row][column:]):
        return "a comma is missing between two values"
    found = _ARRAY.match(lines[begun[-1]])
    key = found[1] if found else ""
    return f"the list {key}, which begins in line {begun[-1] + 1}, lacks a ']'"
