"""Fenced blocks of Markdown pages that are marked to be run, and the running of them.

A comment in the line above a block marks it:

    <!-- file: NAME -->   is written to NAME before anything runs
    <!-- tested -->       Python, or sh: lines of casswarm and of python. A page runs in order, as
                          one process: what one block defines, the next may use
    <!-- output -->       each line is printed by one of these, numbers nearly so
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^<!-- (tested|output|file: \S+) -->\n```(\w*)\n(.*?)^```$", re.M | re.S)
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
PREAMBLE = """
import subprocess as _subprocess, sys as _sys
from casswarm.cli import main as _main


def _casswarm(*arguments):
    try:
        _main(arguments, prog_name="casswarm")
    except SystemExit as end:
        assert not end.code, f"casswarm {arguments} ended with {end.code}"


def _python(*arguments):
    _subprocess.run([_sys.executable, "-W", "error", *arguments], check=True)
"""
"""Commands in the process that runs the page: their imports take longer than their work."""


@dataclass(frozen=True)
class Block:
    """A marked block: how it is marked, its language and its text."""

    mark: str
    language: str
    text: str

    @property
    def script(self) -> str:
        """The block as Python."""
        if self.language == "python":
            return self.text
        commands = [shlex.split(line, comments=True) for line in self.text.splitlines()]
        return "\n".join(f"_{name}(*{arguments!r})" for name, *arguments in filter(None, commands))


def blocks(page: Path) -> list[Block]:
    return [Block(*found) for found in BLOCK.findall(page.read_text(encoding="utf-8"))]


def run(page: Path, folder: Path) -> None:
    """Run a page's blocks in a folder; AssertionError where one fails."""
    found = blocks(page)
    for block in found:
        if block.mark.startswith("file: "):
            (folder / block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
    script = "\n".join([PREAMBLE, *(block.script for block in found if block.mark == "tested")])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{page.name}:\n{done.stdout}\n{done.stderr}"
    for block in found:
        if block.mark == "output":
            assert said(block.text, done.stdout), f"{page.name}: not printed:\n{block.text}"


def said(told: str, printed: str) -> bool:
    """Whether all lines told were printed; numbers may differ in their last digits."""
    lines = [_parts(line) for line in printed.splitlines()]
    return all(
        any(words == other and near(values, others) for other, others in lines)
        for words, values in map(_parts, filter(None, map(str.strip, told.splitlines())))
    )


def _parts(line: str) -> tuple[str, list[float]]:
    return " ".join(NUMBER.sub("#", line).split()), [float(n) for n in NUMBER.findall(line)]


def near(told: list[float], printed: list[float]) -> bool:
    return all(abs(a - b) <= 0.003 + 0.02 * abs(b) for a, b in zip(told, printed, strict=True))
