"""Marked code blocks of Markdown pages, and how to run them.

A comment in the line above a block marks it:

    <!-- file: NAME -->   written to NAME before anything runs
    <!-- tested -->       Python, or sh with lines of casswarm and of python. The blocks of a page
                          run in order in one process and share their names
    <!-- tested with PACKAGE -->  as tested, where an optional package is installed
    <!-- output -->       each line is printed by a tested block; numbers may differ slightly
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

BLOCK = re.compile(
    r"^<!-- (tested(?: with \w+)?|output|file: \S+) -->\n```(\w*)\n(.*?)^```$", re.M | re.S
)
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
PREAMBLE = """
import subprocess as _subprocess, sys as _sys
from casswarm.cli import main as _main


def _casswarm(*arguments):
    try:
        _main(arguments, prog_name="casswarm")
    except SystemExit as end:
        assert not end.code, f"casswarm {arguments} exited with {end.code}"


def _python(*arguments):
    _subprocess.run([_sys.executable, "-W", "error", *arguments], check=True)
"""
"""Commands run in the page's own process: importing takes longer than running them."""


@dataclass(frozen=True)
class Block:
    """A marked block: its mark, language and text."""

    mark: str
    language: str
    text: str

    @property
    def runs(self) -> bool:
        """Whether it is a tested block whose package, if it needs one, is installed."""
        tested, _, package = self.mark.partition(" with ")
        return tested == "tested" and (not package or find_spec(package) is not None)

    @property
    def script(self) -> str:
        """The block as Python."""
        if self.language == "python":
            return self.text
        commands = [shlex.split(line, comments=True) for line in self.text.splitlines()]
        return "\n".join(f"_{name}(*{arguments!r})" for name, *arguments in filter(None, commands))


def blocks(page: Path) -> list[Block]:
    return [Block(*match) for match in BLOCK.findall(page.read_text(encoding="utf-8"))]


def run(page: Path, folder: Path) -> None:
    """Run a page's blocks in a folder; AssertionError where one fails."""
    marked = blocks(page)
    for block in marked:
        if block.mark.startswith("file: "):
            (folder / block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
    script = "\n".join([PREAMBLE, *(block.script for block in marked if block.runs)])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{page.name}:\n{done.stdout}\n{done.stderr}"
    for block in marked:
        if block.mark == "output":
            assert is_printed(block.text, done.stdout), f"{page.name}: not printed:\n{block.text}"


def is_printed(shown: str, printed: str) -> bool:
    """Whether all lines shown were printed; numbers may differ in their last digits."""
    lines = [_parts(line) for line in printed.splitlines()]
    return all(
        any(words == other and near(values, others) for other, others in lines)
        for words, values in map(_parts, filter(None, map(str.strip, shown.splitlines())))
    )


def _parts(line: str) -> tuple[str, list[float]]:
    return " ".join(NUMBER.sub("#", line).split()), [float(n) for n in NUMBER.findall(line)]


def near(shown: list[float], printed: list[float]) -> bool:
    return all(abs(a - b) <= 0.003 + 0.02 * abs(b) for a, b in zip(shown, printed, strict=True))
