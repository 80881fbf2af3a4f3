"""Loading and saving of scenarios: built-in ones, files, and the errors of their syntax."""

from __future__ import annotations

import logging
import os
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from tomllib import TOMLDecodeError
from typing import Any

from .._util.files import require_file
from .._util.text import shown, suggestion
from ..errors import ScenarioError
from .consistency import doubts
from .model import Scenario
from .validation import Problem, as_text, scenario_error

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


LOG = logging.getLogger(__name__)

MAX_BYTES = 1_000_000
"""Largest size of a scenario file."""

MAX_KEY_PARTS = 16
"""Largest number of dotted parts of a key in a scenario file."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")
_TEMPLATE = "start from a built-in one: casswarm scenarios new my.toml --from paper-1"


def load_scenario(source: str | os.PathLike[str], *, allow_code: bool = False) -> Scenario:
    """Scenario of a built-in name, or of a TOML file.

    Parameters
    ----------
    source : str or path
        Name of a built-in scenario (see `builtin_scenarios`), or path of a file.
    allow_code : bool
        Whether the file may name a function of its own as its hazard, which is then imported from
        the file's folder and called: only for files that you trust.

    Raises
    ------
    ScenarioError
        No such scenario, or a file that is no regular file of at most `MAX_BYTES`, cannot be read,
        or is invalid: the message names the file and has a line for every invalid key, with its
        value and the allowed values. The error has the attributes `file`, and `key`, `value` and
        `allowed` of the first problem; `problems` has them all.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.load_scenario("paper-1")
    <Scenario 'paper-1': 5 members, 2 radars, saturation hazard, 30 steps>
    """
    texts = _builtin_texts()
    if isinstance(source, str) and source in texts:
        label = f"built-in scenario '{source}'"
        data = _parsed(texts[source], label)
        return Scenario.from_data(data, source=label, allow_code=allow_code)
    path = Path(source)
    label = f"scenario file {path}"
    try:
        data = _parsed(_text(path, str(source), label), label)
        folder = path.resolve().parent
        scenario = Scenario.from_data(data, source=label, folder=folder, allow_code=allow_code)
    except ScenarioError as error:
        vars(error)["file"] = path
        raise
    for text in doubts(scenario):
        LOG.warning("%s: %s", label, text)
    return scenario


def require_scenario(function: str, value: object) -> None:
    """Raise TypeError, with what to do, if an argument of `function` is not a `Scenario`.

    Nothing is loaded instead: a file may name code, which runs only if `load_scenario` allows it.
    """
    if isinstance(value, Scenario):
        return
    advice = "load one with csw.load_scenario, or make one with csw.Scenario.from_data"
    if isinstance(value, str | os.PathLike):
        advice = f"load it first, csw.load_scenario({shown(os.fspath(value))})"
    raise TypeError(
        f"{function}() needs a Scenario, not the {type(value).__name__} {as_text(value)}: {advice}"
    )


def save_scenario(scenario: Scenario, path: str | os.PathLike[str], comments: bool = False) -> None:
    """Write a scenario file that loads as an equal scenario.

    Parameters
    ----------
    scenario : Scenario
    path : str or path
    comments : bool
        Whether to describe every key in a comment.

    Raises
    ------
    ScenarioError
        The file cannot be written, or the hazard cannot be named in a file.
    """
    text = scenario.to_toml(comments)
    try:
        Path(path).write_text(text, encoding="utf-8", newline="\n")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(
            f"cannot write the scenario file {path}: {reason}", file=Path(path)
        ) from error


def builtin_scenarios() -> dict[str, str]:
    """Descriptions of the built-in scenarios, by name."""
    return {name: tomllib.loads(text)["description"] for name, text in _builtin_texts().items()}


def _builtin_texts() -> dict[str, str]:
    texts = {
        entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
        for entry in files(f"{__package__}.builtin").iterdir()
        if entry.name.endswith(".toml")
    }
    return dict(sorted(texts.items()))


def _text(path: Path, source: str, label: str) -> str:
    try:
        require_file(path, MAX_BYTES)
        # Windows editors may start a file with a byte order mark
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"{label} is not text in UTF-8 (byte {error.start}); save it as TOML in UTF-8",
            file=path,
        ) from None
    except OSError as error:
        if source and os.path.isdir(path):  # noqa: PTH112 - pathlib's raises for long names
            raise ScenarioError(f"{label} is a folder; name a TOML file in it", file=path) from None
        if source and not isinstance(error, FileNotFoundError | IsADirectoryError):
            raise ScenarioError(f"{label} cannot be read: {error.strerror}", file=path) from None
    except ValueError:  # a path with a null character
        pass
    names = list(_builtin_texts())
    raise ScenarioError(
        f"no scenario '{source}': it is neither a built-in scenario nor a file"
        f"{suggestion(path.stem, names)}\n  built-in scenarios: {', '.join(names)}",
        value=source,
        allowed=", ".join(names),
    )


def _parsed(text: str, label: str) -> dict[str, Any]:
    if _LONG_KEY.search(text):
        problem = Problem(f"a key in it has more than {MAX_KEY_PARTS} dotted parts", "")
        raise scenario_error(f"{label} cannot be read", [problem])
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        problem = Problem(syntax_message(text, error), "")
        raise scenario_error(f"{label} is not valid TOML", [problem]) from None
    except (ValueError, RecursionError):
        problem = Problem("a number or a nesting of arrays in it is too long", "")
        raise scenario_error(f"{label} cannot be read", [problem]) from None
    if not data:
        raise ScenarioError(f"{label} is empty; {_TEMPLATE}")
    return data
