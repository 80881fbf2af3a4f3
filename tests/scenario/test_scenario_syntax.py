"""Syntax errors of scenario files: the quoted line, the caret and the hint."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from scenario_messages import message

from casswarm import load_scenario

HINTS = {
    "name = ring": 'a text needs quotes: "ring"',
    "name = “ring”": "a text needs straight quotes",
    'name = "ring\na = 1': "a quote is missing",
    "a = True": "write true, in lower case and without quotes",
    "a = yes": "write true, in lower case and without quotes",
    "a = [no]": "write false, in lower case and without quotes",
    "a = None": "omit the key instead",
    "dt = 0,33": "a number has a decimal point: 0.33",
    "dt = .33": "a number needs a digit before its point: 0.33",
    "dt = 5.": "a number needs a digit after its point: 5.0",
    "dt = 05": "a number has no zeros in front",
    "dt = 1/3": "a number stands alone: no units, no calculations",
    "dt = 3 m": "a number stands alone: no units, no calculations",
    "dt: 0.33": "write KEY = VALUE, or [TABLE] in brackets",
    "dt =": "the key has no value",
    "a = [(0, 0)]": "a list is written in square brackets",
    "a = [0.5 0.5]": "a comma is missing between two values",
    "a = [\n  [0, 0]\n  [1, 1]\n]": "a comma is missing between two values",
    "a = [[3, 4], [5, 6]\n[time]\ndt = 1": "the list a, which begins in line 1, lacks a ']'",
    "b = 1\na = [[3, 4],": "the list a, which begins in line 2, lacks a ']'",
    "a = [1, 2]]": "there is a ']' too many",
    "a = [1,,2]": "there is a comma too many",
    "[time\ndt = 1": "a ']' must end the name of the table",
    "a = 1\na = 2": "a key or table may occur only once",
    'a = "C:\\users"': r"a backslash in a text is written \\, or use single quotes",
    "// slow": "one KEY = VALUE a line; comments start with '#'",
}


@pytest.mark.parametrize("text", HINTS)
def test_syntax_error_has_a_hint(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    found = message(load_scenario, path)
    assert found.startswith(f"scenario file {path} is not valid TOML:\n  ")
    assert f"  hint: {HINTS[text]}" in found.splitlines()[-1]


def test_syntax_error_quotes_the_line_with_a_caret(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\r\n[time]\r\n\tdt = 0,33\r\n', newline="")
    assert message(load_scenario, path).splitlines()[1:] == [
        "  Expected newline or end of document after a statement (at line 3, column 8)",
        "     dt = 0,33",
        "           ^",
        "  hint: a number has a decimal point: 0.33",
    ]


def test_syntax_error_in_a_long_line_is_short_and_soon_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"a = [{'1' * 4000}, {'1, ' * 20_000} x y]\n")
    started = time.perf_counter()
    lines = message(load_scenario, path).splitlines()
    assert time.perf_counter() - started < 20.0
    assert max(map(len, lines)) < 200
    assert lines[-2].index("^") == lines[-3].index("x")
